"""The keys of the page: which one does what, and the dialog that lists them."""

from edhas_jax.workbench.views.elements import Button, Quiet, dialog
from edhas_jax.workbench.views.table import show_table

NEXT_RUN, PREVIOUS_RUN, NEXT_SIGNAL, PREVIOUS_SIGNAL, HELP = "n", "p", "s", "S", "?"
KEYS = {
    "1 … 9": "the views, in their order",
    f"{NEXT_RUN}, {PREVIOUS_RUN}": "next and previous run",
    f"{NEXT_SIGNAL}, {PREVIOUS_SIGNAL}": "next and previous signal",
    HELP: "this list",
    "Esc": "close what is open",
}
MOUSE = "In a plot: drag to zoom, click twice to go back. Every view, run and signal has its address; Back goes back."


def show_keys(page) -> None:
    """Show the list of keys."""
    with dialog(page, "Keys", "keys") as shown:
        show_table(("key", "what it does"), KEYS.items())
        Quiet(MOUSE)
        Button("Close", on_click=shown.close)


def neighbour(names: list[str], name: str, step: int) -> str:
    """The name `step` places after a name in a circle of names; the first one where the name is none of them."""
    return names[(names.index(name) + step) % len(names)] if name in names else names[0]
