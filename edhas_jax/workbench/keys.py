"""The keys of the page: which one does what, and the dialog that lists them."""

from nicegui import ui

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
    with page.floor, ui.dialog().props("aria-label='Keys'") as dialog, ui.card().props("data-mark=keys"):
        ui.label("Keys").classes("text-base font-semibold")
        with ui.element("table").classes("wb-table"):
            for key, what in KEYS.items():
                with ui.element("tr"):
                    for text in (key, what):
                        with ui.element("td"):
                            ui.label(text)
        ui.label(MOUSE).classes("wb-quiet")
        ui.button("Close", on_click=dialog.close).props("flat no-caps")
    dialog.on("hide", dialog.delete)
    dialog.open()


def neighbour(names: list[str], name: str, step: int) -> str:
    """The name `step` places after a name in a circle of names; the first one where the name is none of them."""
    return names[(names.index(name) + step) % len(names)] if name in names else names[0]
