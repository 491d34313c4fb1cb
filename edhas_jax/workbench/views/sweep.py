"""A sweep over two parameters of a design: heat map of a metric, Pareto front, a click on a cell shows its cycle."""

from collections.abc import Awaitable, Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from nicegui import ui

from edhas_jax.core.chart import Chart, Curve, Style, Tone
from edhas_jax.core.units import exact_quantity
from edhas_jax.workbench.figure_parts import chart_figure, title_of
from edhas_jax.workbench.figures import heat_map_figure
from edhas_jax.workbench.jobs import DONE, RUNNING, Job
from edhas_jax.workbench.views.elements import Choice, Head, MainButton
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.workspace import DESIGNS, RESULTS

GRID = 9  # values of each parameter


class SweepPanel:
    """The choice of two parameters and a metric, and the result of the last sweep.

    Args:
        page: the window.
        opened: the machine, see `DesignCalculations.open`, with its `file`.
        values: the values of the sliders (SI); the sweep holds the others.
        on_design: called with the parameters (SI) of a design that was clicked.
    """

    def __init__(
        self, page, opened: Mapping[str, Any], values: Mapping[str, float],
        on_design: Callable[[dict[str, float]], Awaitable[None]],
    ):  # fmt: skip
        self._page, self._opened, self._values, self._on_design = page, opened, values, on_design
        self._sweep: dict[str, Any] | None = None
        last = page.session.jobs.last("sweep")
        self._seen, self._known = (0, False), 0 if last is None else last.number

    def _parameter(self, name: str) -> dict[str, Any]:
        return next(row for row in self._opened["parameters"] if row["name"] == name)

    def _text(self, name: str, value: float) -> str:
        return exact_quantity(value, self._parameter(name)["unit"])

    async def refresh(self) -> None:
        """Show the result of a sweep that has ended, in the colours of the page."""
        job = self._page.session.jobs.last("sweep")
        if job is not None and job.status != RUNNING and (job.number, self._page.dark) != self._seen:
            self._seen = job.number, self._page.dark
            await self._show_sweep(job)

    def build(self, ranged: Mapping[str, str], first: list[str]) -> None:
        """Build the panel.

        Args:
            ranged: description of each parameter that has a range.
            first: parameters that are proposed.
        """
        defaults = [*first, *ranged]
        Head("A metric over two parameters")
        with ui.row().classes("items-end gap-3"):
            vertical = defaults[2 if len(defaults) > 2 else 1]
            self._x = Choice(ranged, value=defaults[0], label="horizontal", with_input=True).classes("min-w-48")
            self._y = Choice(ranged, value=vertical, label="vertical", with_input=True).classes("min-w-48")
            metrics = _titles(self._opened["metrics"])
            self._metric = Choice(metrics, value=next(iter(metrics)), label="metric", on_change=self._draw_heat_map)
            self._metric.classes("min-w-44")
            MainButton(f"Sweep {GRID} × {GRID}", on_click=self._start_sweep)
        with ui.element("div").classes("wb-two"):
            self._heat, self._front = Plot("heat", {"plotly_click": self._click_cell}), Plot("front")

    def _start_sweep(self) -> None:
        if self._x.value == self._y.value:
            self._page.tell("Choose two different parameters.")
            return
        workspace, names = self._page.workspace, (self._x.value, self._y.value)
        task: dict[str, Any] = {"base": str(workspace.inside(self._opened["file"]))}
        if held := {n: self._text(n, value) for n, value in self._values.items() if n not in names}:
            task["parameters"] = held
        ranges = {name: [self._text(name, end) for end in self._parameter(name)["range"]] for name in names}
        axes = {name: {"from": low, "to": high, "count": GRID} for name, (low, high) in ranges.items()}
        task["sweep"] = {"kind": "grid", "parameters": axes}
        stem = f"{Path(self._opened['file']).stem}_{names[0]}_{names[1]}".replace(".", "_")
        number = 1
        while workspace.inside(Path(RESULTS, DESIGNS, f"{stem}-{number}")).exists():
            number += 1
        folder = Path(RESULTS, DESIGNS, f"{stem}-{number}")
        file = folder.with_name(f"{folder.name}.yaml")
        workspace.write(file, yaml.safe_dump(task, sort_keys=False, allow_unicode=True))
        job = self._page.attempt(lambda: self._page.session.run_design_task("sweep", str(file), str(folder)))
        if job is not None:
            self._page.show_state()

    async def _show_sweep(self, job: Job) -> None:
        folder = Path(job.arguments[job.arguments.index("--out") + 1]).name
        if not folder.startswith(f"{Path(self._opened['file']).stem}_"):
            return  # of another machine
        if job.status != DONE:
            if job.number > self._known:
                self._page.tell(self._page.session.jobs.output(job)[-2000:] or "The sweep was cancelled.")
            return
        found = await self._page.ask("design.sweep", str(Path(RESULTS, DESIGNS, folder)))
        if found is None:
            return
        if len(found["parameters"]) != 2 or len(found["status"]) != GRID**2:
            return  # of another kind; `edhas plot sweep` draws it
        self._sweep = found | {"folder": str(Path(RESULTS, DESIGNS, folder))}
        metrics = _titles(found["metrics"])
        self._metric.follow(metrics, self._metric.value, next(iter(metrics)))
        self._draw_heat_map()
        await self._draw_front()

    def _draw_heat_map(self) -> None:
        sweep = self._sweep
        if sweep is None or self._metric.value not in sweep["metrics"]:
            return
        first, second = sweep["parameters"][:2]
        x, y = np.unique(sweep["shown"][first]), np.unique(sweep["shown"][second])
        z = np.full((len(y), len(x)), np.nan)
        at = np.searchsorted(y, sweep["shown"][second]), np.searchsorted(x, sweep["shown"][first])
        z[at] = sweep["shown"][self._metric.value]
        labels = tuple(title_of(name, sweep["units"][name]) for name in (first, second, self._metric.value))
        self._heat.show(heat_map_figure(x, y, z, labels, self._page.dark))

    async def _draw_front(self) -> None:
        metrics = self._sweep["metrics"]
        pump = "mean_flow" in metrics
        first, second = ("mean_flow" if pump else "tracking_error"), "mean_electrical_power"
        if first not in metrics or second not in metrics:
            return
        signs = (1.0 if pump else -1.0, -1.0)
        front = await self._page.ask("design.pareto_front", self._sweep["folder"], first, second, signs)
        if front is None:
            return
        shown, units = self._sweep["shown"], self._sweep["units"]
        titles = (title_of(name, units[name]) for name in (first, second))
        x, y = shown[first], shown[second]
        curves = (
            Curve("designs", x, y, Tone.BESIDE, Style.MARKS),
            Curve("front", x[front], y[front], Tone.MODEL, Style.MARKED),
        )
        self._front.show(chart_figure(Chart(*titles, curves), 380.0, self._page.dark).plain)

    async def _click_cell(self, event) -> None:
        """Show the cycle of the design that was clicked."""
        points = (event.args or {}).get("points") or []
        if not points or self._sweep is None:
            return
        first, second = self._sweep["parameters"][:2]
        shown = self._sweep["shown"]
        shares = (np.abs(shown[n] - points[0][along]) / np.ptp(shown[n]) for n, along in ((first, "x"), (second, "y")))
        row = int(np.argmin(sum(shares)))
        await self._on_design({name: float(self._sweep["si"][name][row]) for name in (first, second)})


def _titles(names: Iterable[str]) -> dict[str, str]:
    return {name: name.replace("_", " ") for name in names}
