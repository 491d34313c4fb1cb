"""What commands print with: the console, tables, the content of a folder."""

import sys
from pathlib import Path

PIPE_WIDTH = 200  # characters; a pipe has no width of its own
FIGURE_DPI = 130
RIGHT_ALIGNED = ("value", "default", "share", "energy")


def console():
    """A rich console as wide as the terminal, or `PIPE_WIDTH` characters wide where there is none."""
    from rich.console import Console

    return Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=PIPE_WIDTH)


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

    columns = [TextColumn("{task.description}"), BarColumn(), *([TimeRemainingColumn()] if time_remaining else [])]
    return Progress(*columns, transient=True, console=out)


def print_remarks(out, remarks) -> None:
    """Print remarks on measured data, at most ten lines."""
    from rich.markup import escape

    from edhas_jax.measurements.remark_list import brief_lines

    for line in brief_lines(remarks):
        out.print(escape(line), soft_wrap=True)


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
