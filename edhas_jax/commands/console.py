"""What commands print with: the console, the summary of a result as text or as JSON, the content of a folder."""

import json
import shlex
import sys
from pathlib import Path

from edhas_jax.core.literal_text import terminal_text

PIPE_WIDTH = 100_000  # characters; a pipe has no width, and nothing is cut or wrapped for one
RIGHT_ALIGNED = ("value", "default", "share", "energy")


def console(options=None):
    """A rich console as wide as the terminal; texts are data.

    Where there is no terminal nothing is wrapped or cut. With `--json` or `--quiet` nothing is printed on it.
    """
    from edhas_jax.commands.plain_console import PlainConsole

    silent = getattr(options, "json", False) or getattr(options, "quiet", False)
    return PlainConsole(quiet=silent, **({} if sys.stdout.isatty() else {"width": PIPE_WIDTH}))


def headed(head: str, text: str):
    """A text for the console that begins with words in bold."""
    from rich.text import Text

    return Text.assemble((terminal_text(head), "bold"), terminal_text(text))


def styled(text: str, style: str):
    """A text for the console in a style, such as "bold" or a colour."""
    from rich.text import Text

    return Text.assemble((terminal_text(text), style))


def table(title: str | None, *columns: str, caption: str | None = None):
    """An empty rich table with these columns; a cell that does not fit continues on the next line."""
    from rich import box
    from rich.table import Table

    empty = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title_style="bold",
                  caption=caption, caption_justify="left")  # fmt: skip
    for column in columns:
        empty.add_column(column, justify="right" if column in RIGHT_ALIGNED else "left", overflow="fold")
    return empty


def print_summary(out, summary) -> None:
    """Print the title, tables and sentences of a `Summary`."""
    from edhas_jax.core.summary import SummaryTable

    head, colon, rest = summary.title.partition(": ")
    out.print(headed(head, colon + rest), soft_wrap=True)
    for part in summary.parts:
        if isinstance(part, SummaryTable):
            print_table(out, part)
        else:
            out.print(_in_tone(part), soft_wrap=True)


def print_table(out, shown) -> None:
    """Print a `SummaryTable`."""
    rows = table(shown.title or None, *shown.columns, caption=shown.caption or None)
    for row in shown.rows:
        rows.add_row(*map(_in_tone, row))
    out.print(rows)


def _in_tone(text):
    from edhas_jax.core.summary import Tone, Toned

    if not isinstance(text, Toned):
        return text
    styles = {Tone.GOOD: "green", Tone.CAUTION: "yellow", Tone.BAD: "bold red", Tone.QUIET: "dim"}
    return styled(text.text, styles.get(text.tone, "bold"))


def finish(options, out, summary, folder: Path | None = None, next_command: str = "", written: str = "") -> None:
    """End a command: the summary, what was written and where, and the next sensible command.

    With `--json` one JSON object goes to the standard output instead: the summary with `written` and `next`.

    Args:
        options: of the command line.
        out: the console.
        summary: of the result.
        folder: the folder that was written; None: none.
        next_command: the next sensible command, without "edhas"; empty: none.
        written: the file that was written, where it is no folder.
    """
    if getattr(options, "json", False):
        data = summary.as_json()
        if folder is not None or written:
            data["written"] = str(folder or written)
        print_json(data | ({"next": f"edhas {next_command}"} if next_command else {}))
        return
    print_summary(out, summary)
    if folder is not None:
        out.print(f"written to {folder}: {file_names(folder)}", soft_wrap=True)
    elif written:
        out.print(f"written: {written}", soft_wrap=True)
    if next_command:
        out.print(f"next: edhas {next_command}", soft_wrap=True)


def print_json(data) -> None:
    """Print data as JSON, in ASCII where the terminal has no Unicode."""
    from edhas_jax.core.summary import jsonable

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


def save_figure(figure, path: Path) -> None:
    """Write a matplotlib figure, see `edhas_jax.tasks.result.save_figure`."""
    from edhas_jax.tasks.result import save_figure

    save_figure(figure, path)


def file_names(folder: Path) -> str:
    """The names of the files in a folder, hidden ones left out, in alphabetical order."""
    return ", ".join(sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))
