"""Design: sliders with the picture of a cycle, sweeps as heat maps, Pareto front, tasks of sizing and sensitivity."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import yaml_text
from edhas_jax.core.units import exact_quantity, format_quantity
from edhas_jax.workbench.calculator import CalculationCancelled, CalculationError
from edhas_jax.workbench.figures import heat_map_figure, lines_figure, points_figure
from edhas_jax.workbench.jobs import RUNNING
from edhas_jax.workbench.workspace import CALIBRATED, DESIGNS, DIAGNOSED, RESULTS

AS_GIVEN = "the campaign's model"
FIRST_SLIDERS = ("frequency", "amplitude", "piston_clearance", "load_orifice_area", "coil_resistance", "force_constant")
FIRST_SIGNALS = ("voltage", "current", "piston_position", "outlet_pressure", "outlet_flow")
SHOWN_METRICS = (
    "mean_flow", "outlet_pressure", "mean_electrical_power", "overall_efficiency", "volumetric_efficiency",
    "amplitude_ratio", "tracking_error", "peak_current", "pressure_ripple",
)  # fmt: skip
STEPS = 60  # of a slider
GRID = 9  # values of each parameter of a sweep
TASKS = {"sizing": "size", "size": "size", "sensitivity": "sensitivity", "sweep": "sweep"}


class DesignView:
    """One machine: its parameters, a cycle, a sweep over two of them."""

    def __init__(self, page):
        self._page = page
        self._source, self._opened = "", None
        self._values: dict[str, float] = {}
        self._sliders: list[str] = []
        self._wanted, self._is_running = False, False
        self._run: dict[str, Any] | None = None
        self._sweep: dict[str, Any] | None = None
        self._sweep_job = 0

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-end gap-4"):
            self._sources = ui.select(self._source_names(), label="machine").classes("min-w-56")
            self._sources.props("dense options-dense outlined").on_value_change(self._choose_source)
            self._more = ui.select({}, label="add a slider for", with_input=True).classes("min-w-56")
            self._more.props("dense options-dense outlined clearable").on_value_change(self._add_slider)
            ui.button("Reset", on_click=self._reset).props("no-caps flat dense")
        self._body = ui.column().classes("w-full gap-4 mt-2")
        names = self._source_names()
        if names:
            config = self._page.workspace.config
            self._sources.set_value(config.name if config is not None else names[0])
        else:
            with self._body:
                ui.label("There is no configuration in this folder: open the workbench on one, such as configs/paper.yaml.")

    async def refresh(self) -> None:
        """Follow the folder: a sweep that has ended."""
        names = self._source_names()
        if self._sources.options != names:
            self._sources.set_options(names, value=self._source if self._source in names else None)
        job = self._page.session.jobs.last("sweep")
        if job is not None and job.status != RUNNING and job.number != self._sweep_job and self._opened is not None:
            self._sweep_job = job.number
            await self._show_sweep()

    async def redraw(self) -> None:
        """Draw the plots again, in the colours of the page."""
        if self._run is not None:
            self._draw_cycle()
        if self._sweep is not None:
            self._draw_heat_map()

    def _source_names(self) -> list[str]:
        workspace = self._page.workspace
        names = [AS_GIVEN] if workspace.has_campaign else []
        names += [str(Path(RESULTS, name, "config.yaml")) for name in (CALIBRATED, DIAGNOSED)
                  if workspace.models().get(name) is not None]  # fmt: skip
        for path in sorted(workspace.folder.glob("*.yaml")):
            head = path.read_text(encoding="utf-8", errors="replace")[:20_000]
            if path.name != "campaign.yaml" and "\nrig:" in f"\n{head}" and not self._task_of(head):
                names.append(path.name)
        return names

    @staticmethod
    def _task_of(text: str) -> str | None:
        """The command that runs a task file; None for a configuration."""
        return next((command for key, command in TASKS.items() if f"\n{key}:" in f"\n{text}"), None)

    async def _choose_source(self, event) -> None:
        if not event.value:
            return
        self._source = event.value
        name = await self._page.ask("design.campaign_machine") if event.value == AS_GIVEN else event.value
        if name is None:
            return
        found = await self._page.ask("design.open", name, self._page.session.allowed)
        if found is None:
            return
        self._opened = found | {"file": name}
        self._values, self._run, self._sweep = {}, None, None
        known = {row["name"]: row for row in found["parameters"] if row["range"]}
        self._sliders = [n for n in FIRST_SLIDERS if n in known] or list(known)[:5]
        self._build_body()
        await self._simulate()

    def _parameter(self, name: str) -> dict[str, Any]:
        return next(row for row in self._opened["parameters"] if row["name"] == name)

    def _build_body(self) -> None:
        self._body.clear()
        ranged = {row["name"]: f"{row['name'].replace('_', ' ')} – {row['doc']}" for row in self._opened["parameters"] if row["range"]}
        self._more.set_options({n: t for n, t in ranged.items() if n not in self._sliders}, value=None)
        with self._body:
            with ui.element("div").classes("wb-split"):
                self._panel = ui.column().classes("gap-1 w-full")
                with ui.column().classes("gap-1 w-full"):
                    self._status = ui.label("").classes("wb-quiet").props("data-mark=cycle-status")
                    self._metrics = ui.row().classes("gap-x-5 gap-y-1")
                    self._cycle = ui.plotly({"data": [], "layout": {"height": 300}}).classes("w-full").props("data-mark=cycle")
            self._fill_panel()
            if self._opened["sweepable"]:
                self._build_sweep(ranged)
            self._build_tasks()

    def _fill_panel(self) -> None:
        self._panel.clear()
        with self._panel:
            for name in self._sliders:
                self._slider(self._parameter(name))

    def _slider(self, row: dict[str, Any]) -> None:
        low, high = row["range"]
        log = low > 0.0 and high / low > 20.0
        value = self._values.get(row["name"], row["value"])

        def at(position: float) -> float:
            share = position / STEPS
            return low * (high / low) ** share if log else low + share * (high - low)

        share = np.log(value / low) / np.log(high / low) if log else (value - low) / (high - low)
        with ui.column().classes("gap-0 w-full"):
            with ui.row().classes("w-full no-wrap items-baseline"):
                ui.label(row["name"].replace("_", " ")).classes("ellipsis").tooltip(row["doc"])
                ui.space()
                text = ui.label(format_quantity(value, row["unit"])).classes("font-semibold")
            slider = ui.slider(min=0, max=STEPS, step=1, value=round(float(share) * STEPS))
            slider.props["aria-label"] = row["name"]
            slider.props(f"data-mark=slider-{row['name']}")

            async def move(event) -> None:
                self._values[row["name"]] = at(event.value)
                text.set_text(format_quantity(at(event.value), row["unit"]))
                await self._simulate()

            slider.on_value_change(move)

    async def _add_slider(self, event) -> None:
        if event.value and event.value not in self._sliders:
            self._sliders.append(event.value)
            self._fill_panel()

    async def _reset(self) -> None:
        if self._opened is not None:
            self._values = {}
            self._fill_panel()
            await self._simulate()

    async def _simulate(self) -> None:
        """Run the machine with the values of the sliders; of values that come meanwhile only the last are run."""
        self._wanted = True
        if self._is_running:
            return
        self._is_running = True
        try:
            while self._wanted:
                self._wanted = False
                began = time.perf_counter()
                try:
                    self._run = await self._page.session.calculator.call(
                        "design.simulate", self._opened["file"], self._page.session.allowed, dict(self._values)
                    )
                except (CalculationError, CalculationCancelled) as error:
                    self._status.set_text(str(error) or "cancelled")
                    continue
                self._draw_cycle(time.perf_counter() - began)
        finally:
            self._is_running = False
        self._note_step()

    def _note_step(self) -> None:
        shown = self._page.workspace.shown
        words = [f"{name}={exact_quantity(value, self._parameter(name)['unit']).replace(' ', '')}" for name, value in self._values.items()]
        command = f"edhas simulate {shown / self._opened['file']}" + "".join(f" --set {word}" for word in words)
        values = ", ".join(f"{name}={value!r}" for name, value in self._values.items())
        python = f'config = edhas.load("{shown / self._opened["file"]}"); edhas.simulate(edhas.change(config.machine, {values}), config.simulation)'
        self._page.did("simulate", command, python)

    def _draw_cycle(self, seconds: float | None = None) -> None:
        run = self._run
        names = [n for n in FIRST_SIGNALS if n in run["signals"]]
        panels = []
        for name in names:
            curves = [(name.replace("_", " "), run["time"], run["signals"][name])]
            if name == "piston_position" and "reference" in run["signals"]:
                curves.append(("set point", run["time"], run["signals"]["reference"]))
            panels.append((name.replace("_", " "), run["units"][name], curves))
        self._cycle.update_figure(lines_figure(panels, "time within the last cycle, ms", self._page.dark))
        state = f"{run['status']}: {run['reason']}" if run["reason"] else run["status"]
        took = "" if seconds is None else f" · {seconds:.2f} s"
        self._status.set_text(f"{state} · {run['step']}{took}")
        self._metrics.clear()
        with self._metrics:
            for name in SHOWN_METRICS:
                if name in run["metrics"]:
                    unit = run["metric_units"].get(name, "")
                    with ui.column().classes("gap-0"):
                        ui.label(name.replace("_", " ")).classes("wb-quiet")
                        ui.label(f"{run['metrics'][name]:.4g} {unit if unit != '-' else ''}").classes("font-semibold")

    def _build_sweep(self, ranged: dict[str, str]) -> None:
        defaults = [*self._sliders, *ranged]
        ui.label("A metric over two parameters").classes("wb-h")
        with ui.row().classes("items-end gap-3"):
            self._x = ui.select(ranged, value=defaults[0], label="horizontal", with_input=True).classes("min-w-48")
            self._y = ui.select(ranged, value=defaults[2 if len(defaults) > 2 else 1], label="vertical", with_input=True)
            self._y.classes("min-w-48")
            self._metric = ui.select(list(SHOWN_METRICS), value="mean_flow", label="metric").classes("min-w-44")
            for field in (self._x, self._y, self._metric):
                field.props("dense options-dense outlined")
            self._metric.on_value_change(lambda _: self._draw_heat_map())
            ui.button(f"Sweep {GRID} × {GRID}", on_click=self._start_sweep).props("no-caps unelevated")
        with ui.element("div").classes("wb-two"):
            self._heat = ui.plotly({"data": [], "layout": {"height": 80}}).classes("w-full").props("data-mark=heat")
            self._heat.on("plotly_click", self._click_cell)
            self._front = ui.plotly({"data": [], "layout": {"height": 80}}).classes("w-full").props("data-mark=front")
        self._heat.set_visibility(False)
        self._front.set_visibility(False)

    def _start_sweep(self) -> None:
        if self._x.value == self._y.value:
            self._page.tell("Choose two different parameters.")
            return
        workspace = self._page.workspace
        lines = [f"base: {yaml_text(str(workspace.inside(self._opened['file'])))}"]
        if self._values:
            lines.append("parameters:")
            lines += [f"  {n}: {exact_quantity(v, self._parameter(n)['unit'])}" for n, v in self._values.items()
                      if n not in (self._x.value, self._y.value)]  # fmt: skip
            lines = lines[:-1] if lines[-1] == "parameters:" else lines
        lines += ["sweep:", "  kind: grid", "  parameters:"]
        for name in (self._x.value, self._y.value):
            row = self._parameter(name)
            low, high = (exact_quantity(v, row["unit"]) for v in row["range"])
            lines.append(f"    {name}: {{from: {low}, to: {high}, count: {GRID}}}")
        stem = f"{Path(self._opened['file']).stem}_{self._x.value}_{self._y.value}".replace(".", "_")
        number = 1
        while workspace.inside(Path(RESULTS, DESIGNS, f"{stem}-{number}")).exists():
            number += 1
        file, folder = Path(RESULTS, DESIGNS, f"{stem}-{number}.yaml"), Path(RESULTS, DESIGNS, f"{stem}-{number}")
        path = workspace.inside(file)
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as temporary:
            temporary.write_text("\n".join([*lines, ""]), encoding="utf-8")
        job = self._page.attempt(lambda: self._page.session.run_design_task("sweep", str(file), str(folder)))
        if job is not None:
            self._page.show_state()

    async def _show_sweep(self) -> None:
        job = self._page.session.jobs.last("sweep")
        folder = Path(job.arguments[job.arguments.index("--out") + 1]).name
        if job.status != "done":
            self._page.tell(self._page.session.jobs.output(job)[-2000:] or "The sweep was cancelled.")
            return
        found = await self._page.ask("design.sweep", str(Path(RESULTS, DESIGNS, folder)))
        if found is None or not self._opened["sweepable"]:
            return
        self._sweep = found | {"folder": str(Path(RESULTS, DESIGNS, folder))}
        metrics = list(found["metrics"])
        chosen = self._metric.value if self._metric.value in metrics else metrics[0]
        self._metric.set_options(metrics, value=chosen)
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
        labels = tuple(self._label(name) for name in (first, second, self._metric.value))
        self._heat.set_visibility(True)
        self._heat.update_figure(heat_map_figure(x, y, z, labels, self._page.dark))

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
        shown = self._sweep["shown"]
        self._front.set_visibility(True)
        labels = self._label(first), self._label(second)
        self._front.update_figure(points_figure(shown[first], shown[second], front, labels, self._page.dark))

    def _label(self, name: str) -> str:
        unit = self._sweep["units"][name]
        return name.replace("_", " ") + (f", {unit}" if unit not in ("", "-") else "")

    async def _click_cell(self, event) -> None:
        """Show the cycle of the design that was clicked."""
        points = (event.args or {}).get("points") or []
        if not points or self._sweep is None:
            return
        first, second = self._sweep["parameters"][:2]
        distance = [np.abs(self._sweep["shown"][n] - points[0][axis]) for n, axis in ((first, "x"), (second, "y"))]
        row = int(np.argmin(distance[0] / np.ptp(self._sweep["shown"][first]) + distance[1] / np.ptp(self._sweep["shown"][second])))
        for name in (first, second):
            self._values[name] = float(self._sweep["si"][name][row])
            if name not in self._sliders:
                self._sliders.append(name)
        self._fill_panel()
        await self._simulate()

    def _build_tasks(self) -> None:
        """Task files of the folder: sizing, sensitivity, sweeps."""
        workspace, found = self._page.workspace, []
        for path in sorted(workspace.folder.glob("*.yaml")):
            command = self._task_of(path.read_text(encoding="utf-8", errors="replace")[:20_000])
            if command is not None and path.name != "campaign.yaml":
                found.append((path.name, command))
        if not found:
            return
        ui.label("Tasks in this folder").classes("wb-h")
        for name, command in found:
            out = Path(RESULTS, DESIGNS, Path(name).stem)
            with ui.row().classes("items-center gap-3"):
                ui.label(name).classes("font-semibold")
                ui.button(f"edhas {command}", on_click=lambda _, n=name, c=command, o=out: self._run_task(n, c, o)).props("no-caps flat dense")
                pictures = sorted(workspace.inside(out).glob("*.png"))
                for picture in pictures:
                    ui.link(picture.name, f"/results/{DESIGNS}/{out.name}/{picture.name}", new_tab=True)

    def _run_task(self, name: str, command: str, out: Path) -> None:
        self._page.attempt(lambda: self._page.session.run_design_task(command, name, str(out)))
        self._page.show_state()

