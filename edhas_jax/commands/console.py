"""What commands print with: the console, tables, the content of a folder."""

import sys
from pathlib import Path

from edhas_jax.core.literal_text import terminal_text

PIPE_WIDTH = 200  # characters; a pipe has no width of its own
FIGURE_DPI = 130
RIGHT_ALIGNED = ("value", "default", "share", "energy")


def console():
    """A rich console as wide as the terminal, or `PIPE_WIDTH` characters wide where there is none; texts are data."""
    from edhas_jax.commands.plain_console import PlainConsole

    return PlainConsole() if sys.stdout.isatty() else PlainConsole(width=PIPE_WIDTH)


def headed(head: str, text: str, style: str = "bold"):
    """A text for the console that begins with words in bold, or in another style."""
    from rich.text import Text

    return Text.assemble((terminal_text(head), style), terminal_text(text))


def styled(text: str, style: str):
    """A text for the console in a style, such as "bold" or a colour."""
    from rich.text import Text

    return Text.assemble((terminal_text(text), style))


def table(title: str | None, *columns: str):
    """An empty rich table with these columns; those of `RIGHT_ALIGNED` are not wrapped."""
    from rich import box
    from rich.table import Table

    empty = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title_style="bold")
    for column in columns:
        numeric = column in RIGHT_ALIGNED
        empty.add_column(column, justify="right" if numeric else "left", no_wrap=numeric)
    return empty


def progress_bar(out, time_remaining: bool = False):
    """A rich progress bar with a description, removed when it is done."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from edhas_jax.commands.progress_file import ProgressFile

    file = ProgressFile()

    class ReportedProgress(Progress):
        def update(self, task_id, *, total=None, completed=None, description=None, **options) -> None:
            super().update(task_id, total=total, completed=completed, description=description, **options)
            if completed is not None:
                file.report(description or self.tasks[task_id].description, completed)

    columns = [TextColumn("{task.description}", markup=False), BarColumn()]
    columns += [TimeRemainingColumn()] if time_remaining else []
    return ReportedProgress(*columns, transient=True, console=out)


def print_data_check(out, campaign, more=()) -> None:
    """Print what the check of a campaign found, and more remarks: the noise first, then at most ten lines."""
    from edhas_jax.measurements.checks.noise_measurement import noise_sentence
    from edhas_jax.measurements.remark_list import brief_lines

    noise = noise_sentence(campaign)
    remarks = [remark for remark in (*campaign.remarks, *more) if remark.sentence != noise]
    for line in [*([] if noise is None else [noise]), *brief_lines(remarks)]:
        out.print(line, soft_wrap=True)


def save_figure(figure, path: Path) -> None:
    """Write a matplotlib figure in the format that the suffix of `path` names.

    Raises:
        ResultFileError: the file cannot be written, or the format is unknown.
    """
    from edhas_jax.config.run_folder import ResultFileError

    try:
        figure.savefig(path, dpi=FIGURE_DPI)
    except (OSError, ValueError) as error:
        raise ResultFileError(f"{path}: cannot be written: {error}") from None


def file_names(folder: Path) -> str:
    """The names of the files in a folder, hidden ones left out, in alphabetical order."""
    return ", ".join(sorted(p.name for p in folder.iterdir() if not p.name.startswith(".")))
