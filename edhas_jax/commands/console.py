"""What commands print with: the console, the summary of a result as text or as JSON, the content of a folder."""

import json
import shlex
import sys
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from edhas_jax.core.literal_text import terminal_text
from edhas_jax.core.summary import SummaryTable, Tone, Toned, jsonable

PIPE_WIDTH = 100_000  # characters; a pipe has no width, and nothing is cut or wrapped for one
RIGHT_ALIGNED = ("value", "default", "share", "energy")
STYLES = {Tone.GOOD: "green", Tone.CAUTION: "yellow", Tone.BAD: "bold red", Tone.QUIET: "dim", Tone.HEAD: "bold"}


class PlainConsole(Console):
    """A console on which every text is data: no markup, no emoji codes, nothing that a terminal would obey.

    Styles come as `Text` or as the style of a table.
    """

    def __init__(self, **options):
        super().__init__(highlight=False, markup=False, emoji=False, **options)

    def render_str(self, text: str, **options) -> Text:
        """See `Console.render_str`."""
        return super().render_str(terminal_text(text), **options)

    def on_broken_pipe(self) -> None:
        """See `Console.on_broken_pipe`; the command ends as it does wherever else its output has no reader."""
        raise BrokenPipeError


def console(options=None) -> PlainConsole:
    """A console as wide as the terminal.

    Where there is no terminal nothing is wrapped or cut. With `--json` or `--quiet` nothing is printed on it.
    """
    silent = getattr(options, "json", False) or getattr(options, "quiet", False)
    return PlainConsole(quiet=silent, **({} if sys.stdout.isatty() else {"width": PIPE_WIDTH}))


def say(options, *lines: str) -> None:
    """Print lines, none of which is cut."""
    out = console(options)
    for line in lines:
        out.print(line, soft_wrap=True)


def headed(head: str, text: str) -> Text:
    """A text for the console that begins with words in bold."""
    return Text.assemble((terminal_text(head), "bold"), terminal_text(text))


def table(title: str | None, *columns: str, caption: str | None = None) -> Table:
    """An empty table with these columns; a cell that does not fit continues on the next line."""
    empty = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title_style="bold",
                  caption=caption, caption_justify="left")  # fmt: skip
    for column in columns:
        empty.add_column(column, justify="right" if column in RIGHT_ALIGNED else "left", overflow="fold")
    return empty


def print_summary(out, summary) -> None:
    """Print the title, tables and sentences of a `Summary`."""
    head, colon, rest = summary.title.partition(": ")
    out.print(headed(head, colon + rest), soft_wrap=True)
    for part in summary.parts:
        if isinstance(part, SummaryTable):
            print_table(out, part)
        else:
            out.print(_in_tone(part), soft_wrap=True)


def print_table(out, shown: SummaryTable) -> None:
    """Print a `SummaryTable`."""
    rows = table(shown.title or None, *shown.columns, caption=shown.caption or None)
    for row in shown.rows:
        rows.add_row(*map(_in_tone, row))
    out.print(rows)


def _in_tone(text):
    return Text.assemble((terminal_text(text.text), STYLES[text.tone])) if isinstance(text, Toned) else text


def finish(options, summary, folder: Path | None = None, next_command: str = "", written: str = "") -> None:
    """End a command: the summary, what was written and where, and the next sensible command.

    With `--json` one JSON object goes to the standard output instead: the summary with `written` and `next`.

    Args:
        options: of the command line.
        summary: of the result.
        folder: the folder that was written; None: none.
        next_command: the next sensible command, without "edhas"; empty: none.
        written: the file that was written, where it is no folder.
    """
    if options.json:
        data = summary.as_json()
        if folder is not None or written:
            data["written"] = str(folder or written)
        print_json(data | ({"next": f"edhas {next_command}"} if next_command else {}))
        return
    print_summary(console(options), summary)
    if folder is not None:
        say(options, f"written to {folder}: {file_names(folder)}")
    elif written:
        say(options, f"written: {written}")
    if next_command:
        say(options, f"next: edhas {next_command}")


def print_json(data) -> None:
    """Print data as JSON, in ASCII where the terminal has no Unicode."""
    is_unicode = "utf" in (sys.stdout.encoding or "").lower()
    print(json.dumps(jsonable(data), indent=2, ensure_ascii=not is_unicode, allow_nan=False))


def quoted(path: Path | str) -> str:
    """A path as an argument of a command line."""
    return shlex.quote(str(path))


def print_data_check(out, campaign, more=()) -> None:
    """Print what the check of a campaign found, and more remarks: the noise first, then at most ten lines."""
    from edhas_jax.measurements.campaign import brief_lines
    from edhas_jax.measurements.checks.noise_measurement import noise_sentence

    noise = noise_sentence(campaign)
    remarks = [remark for remark in (*campaign.remarks, *more) if remark.sentence != noise]
    for line in [*([] if noise is None else [noise]), *brief_lines(remarks)]:
        out.print(line, soft_wrap=True)


def file_names(folder: Path) -> str:
    """The names of the files in a folder, hidden ones left out, in alphabetical order."""
    return ", ".join(sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))
