"""Names that a user mistyped, and the ones that were meant."""

import difflib


def suggest(name: str, valid) -> str:
    """A clause that names the nearest valid names, or all of them when none is near."""
    close = difflib.get_close_matches(name, list(valid), n=3, cutoff=0.6)
    return ("nearest: " if close else "valid: ") + ", ".join(close or sorted(valid))
