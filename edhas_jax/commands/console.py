"""How commands print: one console, one kind of table."""

import sys


def console():
    """A console that fits the terminal, or a pipe."""
    from rich.console import Console

    # a pipe has no width: let tables be as wide as they are
    return Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=200)


def table(title: str | None, *columns: str):
    """An empty table with these columns."""
    from rich import box
    from rich.table import Table

    made = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title_style="bold")
    for column in columns:
        numeric = column in ("value", "default", "share", "energy")
        made.add_column(column, justify="right" if numeric else "left", no_wrap=numeric)
    return made
