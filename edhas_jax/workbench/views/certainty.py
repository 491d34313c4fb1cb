"""How certain a calibration is: correlations, regions of confidence, profiles, and what its residuals still hold."""

from collections.abc import Callable
from typing import Any

from nicegui import ui

from edhas_jax.core.units import unit_text
from edhas_jax.workbench.calibration_figures import HEIGHT, autocorrelation_figure, correlation_figure, ellipse_figure
from edhas_jax.workbench.figure_parts import chart_figure
from edhas_jax.workbench.views.elements import Button, Choice, Head, Quiet
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.workspace import CALIBRATED


class Certainty:
    """Plots of the finished calibration.

    Args:
        page: the window.
        cell: gives run and signal whose residual is looked at.
    """

    def __init__(self, page, cell: Callable[[], tuple[str, str]]):
        self._page, self._cell = page, cell
        self._shown: Any = None
        self._residual: Any = None
        self._profile: tuple[str, dict] | None = None
        self._body = ui.column().classes("w-full gap-1 mt-2").props("data-mark=certainty")

    async def refresh(self) -> None:
        """Follow the folder, and the run and signal that are drawn."""
        fit, time = self._page.workspace.result(CALIBRATED), self._page.workspace.result_time(CALIBRATED)
        if (time, self._page.dark) != self._shown:
            self._shown, self._residual, self._profile = (time, self._page.dark), None, None
            self._body.clear()
            if fit is None or not fit.get("calibrated"):
                return
            with self._body:
                self._build(fit)
        if fit is not None and fit.get("calibrated"):
            await self._draw_autocorrelation()

    def _build(self, fit: dict[str, Any]) -> None:
        names = {name: name.replace("_", " ") for name in fit["calibrated"]}
        first, second = _most_alike(fit)
        with ui.element("div").classes("wb-two"):
            with ui.column().classes("gap-1 w-full"):
                Head("Correlations of the estimates")
                Plot("correlations").show(correlation_figure(fit["correlation"], self._page.dark))
            with ui.column().classes("gap-1 w-full"):
                Head("Confidence")
                with ui.row().classes("items-end gap-3"):
                    self._one = Choice(names, value=first, label="parameter", on_change=self._draw_ellipse)
                    self._other = Choice(names, value=second, label="together with", on_change=self._draw_ellipse)
                    for field in (self._one, self._other):
                        field.classes("min-w-40")
                    button = Button("Profile", on_click=self._compute_profile)
                    button.tooltip("χ² along the parameter, all others fitted anew: some seconds")
                self._note = Quiet("").props("data-mark=confidence-note")
                self._ellipse, self._along = Plot("ellipse"), Plot("profile")
        self._residual_title = Head("").props("data-mark=residual-title")
        Quiet("Band: 95 % of the values lie in it if the residual is white noise, so that nothing is left to explain. "
              "Over the whole record.")  # fmt: skip
        self._correlogram = Plot("autocorrelation")
        self._draw_ellipse()

    def _draw_ellipse(self) -> None:
        fit = self._page.workspace.result(CALIBRATED)
        one, other = self._one.value, self._other.value
        at_limit = [n for n in (one, other) if fit["calibrated"][n].get("std") is None]
        if at_limit or one == other:
            why = f"{at_limit[0].replace('_', ' ')} is at a limit, so it has no standard error." if at_limit else ""
            self._note.set_text(why or "Choose two different parameters for their common region.")
            self._ellipse.hide()
            return
        self._note.set_text("Region in which both lie together with 95 %, by their standard errors and correlation.")
        self._ellipse.show(ellipse_figure(fit, one, other, self._page.dark))

    async def _compute_profile(self) -> None:
        name = self._one.value
        found = await self._page.ask("fit.profile", name)
        if found is None:
            return
        command = self._page.session.command_fit("--profile", name)
        python = self._page.session.python_fit(name)
        self._page.did(f"calibrate with the profile of {name}", command, python)
        low, high = found["interval"]
        interval = f"{low:.5g} to {high:.5g} {unit_text(found['unit'])}".rstrip()
        self._note.set_text(f"{name.replace('_', ' ')}: {interval} with 95 % by the profile of χ².")
        self._along.show(chart_figure(found["chart"], HEIGHT, self._page.dark).plain)

    async def _draw_autocorrelation(self) -> None:
        cell, time = self._cell(), self._page.workspace.result_time(CALIBRATED)
        if (cell, time, self._page.readings) == self._residual or not all(cell):
            return
        self._residual = cell, time, self._page.readings
        found = await self._page.ask("fit.autocorrelation", CALIBRATED, *cell)
        title = f"Autocorrelation of the residual of {cell[1].replace('_', ' ')}, {cell[0]}, calibrated"
        self._residual_title.set_text(title)
        if found is None:
            self._correlogram.hide()
        else:
            self._correlogram.show(autocorrelation_figure(found, self._page.dark))


def _most_alike(fit: dict[str, Any]) -> tuple[str, str]:
    """The two parameters with standard errors that are most correlated; the first two where there are none."""
    names = [name for name, row in fit["calibrated"].items() if row.get("std") is not None]
    pairs = [(abs(fit["correlation"][a][b] or 0.0), a, b) for k, a in enumerate(names) for b in names[k + 1 :]]
    if pairs:
        return max(pairs)[1:]
    names = list(fit["calibrated"])
    return names[0], names[min(1, len(names) - 1)]
