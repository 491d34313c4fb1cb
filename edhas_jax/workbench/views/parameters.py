"""The uncertain parameters: what was known of each, and what the calibration has found."""

from collections.abc import Mapping
from typing import Any

from nicegui import ui

from edhas_jax.core.units import estimate_text, format_quantity
from edhas_jax.workbench.views.save import csv_button
from edhas_jax.workbench.views.table import show_table
from edhas_jax.workbench.workspace import CALIBRATED

HEADS = "parameter", "given", "known to", "sought from", "to", "calibrated", "moved", "most like"
NOTES = (
    "The parameters under `uncertain` in campaign.yaml are free, all others fixed. Moved: in standard deviations of "
    "what was known. Most like: the parameter whose estimate is most correlated with this one."
)


class Parameters:
    """The table.

    Args:
        page: the window.
    """

    def __init__(self, page):
        self._page, self._shown = page, None
        self._body = ui.column().classes("w-full gap-1 mt-4").props("data-mark=parameters")

    def refresh(self) -> None:
        """Follow the folder."""
        summary, fit = self._page.summary, self._page.workspace.result(CALIBRATED) or {}
        unknowns = {} if summary is None else summary["uncertain"]
        shown = unknowns, fit.get("calibrated"), fit.get("correlation")
        if shown == self._shown:
            return
        self._shown = shown
        self._body.clear()
        if not unknowns:
            return
        rows = [_row(name, unknown, fit) for name, unknown in unknowns.items()]
        with self._body:
            with ui.row().classes("items-center gap-1"):
                ui.label("Uncertain parameters").classes("wb-h")
                csv_button("parameters", lambda: [HEADS, *rows])
            show_table(HEADS, rows)
            ui.label(NOTES).classes("wb-quiet")


def _row(name: str, unknown: Mapping[str, Any], fit: Mapping[str, Any]) -> tuple[str, ...]:
    """A row of the table; what only a calibration tells is empty without one."""
    unit, found = unknown["unit"], fit.get("calibrated", {}).get(name)
    given, low, high = (format_quantity(unknown[key], unit) for key in ("given", "smallest", "largest"))
    known = unknown["known_to"].replace(" ", "\xa0")
    first = name.replace("_", " "), given, known, low, high
    if found is None:
        return (*first, "", "", "")
    estimate = estimate_text(found["value"], found.get("std"), found["unit"], found.get("limit"))
    others = {n: r for n, r in fit.get("correlation", {}).get(name, {}).items() if n != name and r is not None}
    like = max(others, key=lambda n: abs(others[n]), default="")
    return (
        *first, estimate, f"{fit['prior_pull'][name]:+.1f}",
        f"{like.replace('_', ' ')} ({others[like]:+.2f})" if like else "",
    )  # fmt: skip
