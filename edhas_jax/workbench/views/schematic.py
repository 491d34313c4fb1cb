"""The machine, coloured by the probability that something is missing in a part; a part can be clicked."""

from collections.abc import Callable

from nicegui import ui

from edhas_jax.diagnosis.report.machine_schematic import draw_parts, draw_schematic
from edhas_jax.machine.rigs import RIGS

CLICK = "(e) => { const p = e.target.closest('[data-part]'); if (p) emit(p.dataset.part) }"


class Schematic:
    """The drawing.

    Args:
        page: the window.
        on_part: called with the name of a part that was clicked.
    """

    def __init__(self, page, on_part: Callable):
        self._page = page
        self._drawing = ui.html("", sanitize=False).classes("wb-paper").props("data-mark=schematic")
        self._drawing.on("click", lambda event: on_part(event.args), js_handler=CLICK)

    def refresh(self) -> None:
        """Follow the folder."""
        summary = self._page.summary
        if summary is None:
            self._drawing.set_content("")
            return
        probabilities = self._page.standing().where
        rig, measured = RIGS.get(summary["rig"]), tuple(summary["signals"])
        drawn = draw_parts(parts_of(summary)[:-1], probabilities, measured) if rig is None else None
        self._drawing.set_content(drawn or draw_schematic(rig(), probabilities, measured))


def parts_of(summary) -> list[str]:
    """The parts of the machine of a campaign, see `CampaignCalculations.open`; the last one is "sensor"."""
    return list(dict.fromkeys([*(slot["location"] for slot in summary["slots"]), "sensor"]))
