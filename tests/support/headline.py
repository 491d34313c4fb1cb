"""The last line that a study prints: its headline figures as key=value pairs."""

import re


def headline(capsys) -> dict[str, str]:
    """The pairs of the last line printed since the last look.

    Raises:
        AssertionError: the last line is something else.
    """
    line = capsys.readouterr().out.rstrip("\n").rsplit("\n", 1)[-1]
    assert re.fullmatch(r"[a-z][a-z0-9_]*=\S+( [a-z][a-z0-9_]*=\S+)*", line), line
    return dict(pair.split("=", 1) for pair in line.split(" "))
