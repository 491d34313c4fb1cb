"""Where a calibration stands: its cost after every step, and a signal of a run with the present values."""

import asyncio
from typing import Any

from nicegui import ui

from edhas_jax.core.units import to_si
from edhas_jax.workbench.calibration_figures import cost_figure, trajectory_figure
from edhas_jax.workbench.views.elements import Button, Choice, Quiet, Toggle
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.workspace import AS_GIVEN, CALIBRATED

INTERVALS = 500  # into which the plot is divided when a record is thinned
ZOOM, WINDOW = "drag to zoom", "drag to draw the time window"
VIEW = "Calibrate"


class FitProgress:
    """Plot of the cost, and of a chosen signal of a chosen run.

    Args:
        page: the window.
        on_window: called after a time window was drawn.
    """

    def __init__(self, page, on_window):
        self._page, self._on_window = page, on_window
        self._run, self._signal = "", ""
        self._cost_shown: Any = None
        self._drawn: Any = None  # what the plot of the signal was made of
        self._as_given: tuple[Any, Any] = (None, None)
        self._turn = asyncio.Lock()  # timer and clicks may ask at the same time
        with ui.element("div").classes("wb-two"):
            with ui.column().classes("gap-1 w-full"):
                with ui.row().classes("items-center gap-3"):
                    self._runs = Choice([], label="run", on_change=self._choose).classes("min-w-32")
                    self._signals = Choice({}, label="signal", on_change=self._choose).classes("min-w-40")
                    self._drag = Toggle([ZOOM, WINDOW], value=ZOOM, on_change=self.follow)
                    Button("Use all of the run", on_click=self._use_all, icon="zoom_out_map").props("size=sm")
                self._title = Quiet("").props("data-mark=trajectory-title")
                self._plot = Plot("trajectory", {"plotly_selected": self._selected})
            with ui.column().classes("gap-1 w-full"):
                self._cost_title = Quiet("").props("data-mark=cost-title")
                self._cost = Plot("cost")

    @property
    def cell(self) -> tuple[str, str]:
        """Run and signal that are drawn."""
        return self._run, self._signal

    async def refresh(self) -> None:
        """Follow the folder and the place."""
        summary, place = self._page.summary, self._page.place
        if summary is None:
            return
        runs, signals = list(summary["runs"]), list(summary["signals"])
        self._run = self._runs.follow(runs, place.run, self._run, runs[0])
        titles = {name: name.replace("_", " ") for name in signals}
        self._signal = self._signals.follow(titles, place.signal, self._signal, signals[0])
        self._page.shown = self.cell
        await self.follow()

    async def follow(self) -> None:
        """Draw what the job has reported since the last look, where this view is in front."""
        if self._page.summary is None or self._page.place.view != VIEW or self._turn.locked():
            return
        async with self._turn:
            self._draw_cost()
            await self._draw_trajectory()

    def _steps(self) -> list[dict[str, Any]]:
        """The steps of the last calibration."""
        jobs = self._page.session.jobs
        job = jobs.last("calibrate")
        rows = [] if job is None else jobs.progress(job)
        return [row["numbers"] for row in rows if isinstance(row.get("numbers"), dict) and "cost" in row["numbers"]]

    def _draw_cost(self) -> None:
        steps = self._steps()
        if (len(steps), self._page.dark, steps[-1:]) == self._cost_shown:
            return
        self._cost_shown = len(steps), self._page.dark, steps[-1:]
        if not steps:
            self._cost_title.set_text("The cost after every step is drawn here while a calibration runs.")
            self._cost.hide()
            return
        last = steps[-1]
        self._cost_title.set_text(
            f"{last['search']}, step {last['number']}: residual over noise {last['residual_over_noise']:.3f}"
        )
        self._cost.show(cost_figure(steps, self._page.dark))

    def _present(self) -> tuple[str, dict[str, float], dict[str, Any]]:
        """What is drawn over the measured signal: its name, the values of the unknowns, and the choices behind it."""
        job, steps = self._page.session.jobs.running(), self._steps()
        if job is not None and job.title == "calibrate":
            if not steps:
                return AS_GIVEN, {}, {}
            return f"step {len(steps)}", steps[-1]["values"], self._page.session.choices.read()
        fit = self._page.workspace.result(CALIBRATED)
        if fit is None:
            return AS_GIVEN, {}, {}
        rows = {**fit.get("calibrated", {})}
        for run, own in fit.get("of_runs", {}).items():
            rows |= {f"{name} in {run}": row for name, row in own.items()}
        return CALIBRATED, {name: row["value"] for name, row in rows.items()}, fit.get("choices") or {}

    async def _draw_trajectory(self) -> None:
        page, cell = self._page, self.cell
        name, values, choices = self._present()
        window = self._window()
        of = cell, name, values, choices, window, page.dark, self._drag.value, page.readings
        if of == self._drawn:
            return
        given = await self._trajectory_as_given()
        found = given if not values else await page.ask("fit.trajectory", choices, values, *cell, INTERVALS)
        if found is None or given is None:
            self._title.set_text(f"{cell[0]} has no {cell[1].replace('_', ' ')}")
            self._plot.hide()
            self._drawn = of
            return
        curves = {AS_GIVEN: given["model"]} | ({name: found["model"]} if values else {})
        errors = " → ".join(f"{row['over_noise']:.2f}" for row in ([given, found] if values else [given]))
        self._title.set_text(f"{cell[0]} · {cell[1].replace('_', ' ')}: {errors} × noise")
        draws = self._drag.value == WINDOW
        figure = trajectory_figure(found["measured"], curves, found["unit"], window, page.dark, draws)
        self._plot.show(figure)
        self._drawn = of

    async def _trajectory_as_given(self) -> dict[str, Any] | None:
        key = self.cell, self._page.readings
        if self._as_given[0] != key:
            self._as_given = key, await self._page.ask("fit.trajectory", {}, {}, *self.cell, INTERVALS)
        return self._as_given[1]

    def _window(self) -> tuple[float, float] | None:
        """The chosen time window of the run [s]; None where all is used, or what is typed is no time yet."""
        window = self._page.session.choices.read().get("windows", {}).get(self._run)
        try:
            first, last = (to_si(str(text), "s") for text in window)
        except (TypeError, ValueError):
            return None
        return first, last

    async def _choose(self, _) -> None:
        if (self._runs.value, self._signals.value) != self.cell and self._runs.value and self._signals.value:
            self._run, self._signal = self._runs.value, self._signals.value
            self._page.shown = self.cell
            self._page.move(run=self._run, signal=self._signal)
            await self.follow()
            await self._on_window()

    async def _selected(self, event) -> None:
        args = event.args if isinstance(event.args, dict) else {}
        span = (args.get("range") or {}).get("x")
        if self._drag.value != WINDOW or not span:
            return
        end = self._page.summary["runs"][self._run]["end"]
        first, last = (min(max(float(time), 0.0), end) for time in sorted(span))
        self._page.session.choices.set_window(self._run, (f"{first:.5g} s", f"{last:.5g} s"))
        await self.follow()
        await self._on_window()

    async def _use_all(self) -> None:
        self._page.session.choices.set_window(self._run, None)
        await self.follow()
        await self._on_window()
