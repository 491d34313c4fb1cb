"""Design: sliders with the picture of a cycle, sweeps as heat maps, Pareto front, tasks of sizing and sensitivity."""

import time
from pathlib import Path
from typing import Any

import numpy as np
from nicegui import ui

from edhas_jax.config.file_kind import command_of
from edhas_jax.core.units import exact_quantity, format_quantity
from edhas_jax.workbench.calculator import CalculationCancelled, CalculationError
from edhas_jax.workbench.figures import SET_POINT, lines_figure
from edhas_jax.workbench.views.elements import Button, Choice, Head, Quiet, Strong
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.sweep import SweepPanel
from edhas_jax.workbench.workspace import DESIGNS, RESULTS

AS_GIVEN = "the campaign's model"
FIRST_SLIDERS = ("frequency", "amplitude", "piston_clearance", "load_orifice_area", "coil_resistance", "force_constant")
FIRST_SIGNALS = ("voltage", "current", "piston_position", "outlet_pressure", "outlet_flow")
STEPS = 200  # of a slider, about one a pixel
HEAD = 20_000  # characters of a file, by which it is told what it is


class Slider(ui.slider):
    """A slider that the browser moves itself: one that waits for the server springs back while that draws a cycle."""

    LOOPBACK = False


class DesignView:
    """One machine: its parameters, a cycle, a sweep over two of them."""

    def __init__(self, page):
        self._page = page
        self._source, self._opened = "", None
        self._values: dict[str, float] = {}
        self._sliders: list[str] = []
        self._wanted, self._is_running, self._is_dark = False, False, False
        self._run: dict[str, Any] | None = None
        self._sweep: SweepPanel | None = None

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-end gap-4"):
            self._sources = Choice(self._source_names(), label="machine", on_change=self._choose_source)
            self._more = Choice({}, label="add a slider for", with_input=True, on_change=self._add_slider)
            self._more.props("clearable")
            for choice in (self._sources, self._more):
                choice.classes("min-w-56")
            Button("Reset", on_click=self._reset)
        self._body = ui.column().classes("w-full gap-4 mt-2")
        names = self._source_names()
        if names:
            config = self._page.workspace.config
            self._sources.set_value(config.name if config is not None else next(iter(names)))
        else:
            with self._body:
                ui.label("There is no configuration in this folder: open the workbench on one, "
                         "such as configs/paper.yaml.")  # fmt: skip

    async def refresh(self) -> None:
        """Follow the folder, such as a sweep that has ended, and the colours of the page."""
        self._sources.follow(self._source_names(), self._source)
        if self._run is not None and self._is_dark != self._page.dark:
            self._draw_cycle()
        if self._sweep is not None:
            await self._sweep.refresh()

    def _source_names(self) -> dict[str, str]:
        """The machines that can be chosen, by file (or `AS_GIVEN`), with the names that the page has for them."""
        workspace = self._page.workspace
        names = {AS_GIVEN: AS_GIVEN} if workspace.has_campaign else {}
        models = workspace.models().items()
        names |= {str(path.relative_to(workspace.folder)): name for name, path in models if path is not None}
        return names | {name: name for name, command in self._yaml_files() if command == "simulate"}

    def _yaml_files(self) -> list[tuple[str, str | None]]:
        """The YAML files of the folder, each with the command that runs it."""
        paths = sorted(self._page.workspace.folder.glob("*.yaml"))
        return [(p.name, command_of(p.read_text(encoding="utf-8", errors="replace")[:HEAD])) for p in paths]

    async def _choose_source(self, event) -> None:
        if not event.value:
            return
        self._source = event.value
        name = await self._page.ask("design.campaign_machine") if event.value == AS_GIVEN else event.value
        if name is None:
            return
        found = await self._page.ask("design.open", name)
        if found is None:
            return
        self._opened = found | {"file": name}
        self._values, self._run, self._sweep = {}, None, None
        known = {row["name"]: row for row in found["parameters"] if row["range"]}
        self._sliders = [n for n in FIRST_SLIDERS if n in known] or list(known)[:5]
        self._build_body()
        await self._simulate()
        if self._sweep is not None:
            await self._sweep.refresh()

    def _parameter(self, name: str) -> dict[str, Any]:
        return next(row for row in self._opened["parameters"] if row["name"] == name)

    def _build_body(self) -> None:
        self._body.clear()
        ranged = {row["name"]: row["name"].replace("_", " ") for row in self._opened["parameters"] if row["range"]}
        self._more.follow({n: t for n, t in ranged.items() if n not in self._sliders})
        with self._body:
            with ui.element("div").classes("wb-split"):
                self._panel = ui.column().classes("gap-1 w-full")
                with ui.column().classes("gap-1 w-full"):
                    self._status = Quiet("").props("data-mark=cycle-status")
                    self._metrics = ui.row().classes("gap-x-5 gap-y-1")
                    self._cycle = Plot("cycle")
            self._fill_panel()
            if self._opened["sweepable"]:
                self._sweep = SweepPanel(self._page, self._opened, self._values, self._show_design)
                self._sweep.build(ranged, self._sliders)
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
                text = Strong(format_quantity(value, row["unit"]))
            slider = Slider(min=0, max=STEPS, step=1, value=round(float(share) * STEPS))
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
            self._values.clear()
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
                    of = self._opened["file"], dict(self._values)
                    self._run = await self._page.session.calculator.call("design.simulate", *of)
                except (CalculationError, CalculationCancelled) as error:
                    self._status.set_text(str(error) or "cancelled")
                    continue
                self._draw_cycle(time.perf_counter() - began)
        finally:
            self._is_running = False
        self._note_step()

    def _note_step(self) -> None:
        shown = self._page.workspace.shown
        texts = {n: exact_quantity(value, self._parameter(n)["unit"]) for n, value in self._values.items()}
        words = "".join(f" --set {name}={text.replace(' ', '')}" for name, text in texts.items())
        command = f"edhas simulate {shown / self._opened['file']}{words}"
        values = ", ".join(f"{name}={value!r}" for name, value in self._values.items())
        python = f'config = edhas.load("{shown / self._opened["file"]}")\n'
        machine = f"edhas.change(config.machine, {values})" if values else "config.machine"
        python += f"edhas.simulate({machine}, config.simulation)"
        self._page.did("simulate", command, python)

    def _draw_cycle(self, seconds: float | None = None) -> None:
        run, self._is_dark = self._run, self._page.dark
        names = [n for n in FIRST_SIGNALS if n in run["signals"]] or list(run["signals"])[: len(FIRST_SIGNALS)]
        panels = []
        for name in names:
            curves = [(name.replace("_", " "), run["time"], run["signals"][name])]
            if name == "piston_position" and "reference" in run["signals"]:
                curves.insert(0, (SET_POINT, run["time"], run["signals"]["reference"]))
            panels.append((name.replace("_", " "), run["units"][name], curves))
        self._cycle.show(lines_figure(panels, run["time_title"], self._page.dark))
        state = f"{run['status']}: {run['reason']}" if run["reason"] else run["status"]
        took = "" if seconds is None else f" · {seconds:.2f} s"
        self._status.set_text(f"{state} · {run['step']}{took}")
        self._metrics.clear()
        with self._metrics:
            for name, text in run["metrics"].items():
                with ui.column().classes("gap-0"):
                    Quiet(name.replace("_", " "))
                    Strong(text)

    async def _show_design(self, values: dict[str, float]) -> None:
        """Show the cycle of a design of a sweep."""
        self._values.update(values)
        self._sliders += [name for name in values if name not in self._sliders]
        self._fill_panel()
        await self._simulate()

    def _build_tasks(self) -> None:
        """Task files of the folder: sizing, sensitivity, sweeps."""
        workspace = self._page.workspace
        found = [(name, command) for name, command in self._yaml_files() if command not in (None, "simulate")]
        if not found:
            return
        Head("Tasks in this folder")
        for name, command in found:
            out = Path(RESULTS, DESIGNS, Path(name).stem)
            with ui.row().classes("items-center gap-3"):
                Strong(name)
                Button(f"edhas {command}", on_click=lambda _, n=name, c=command, o=out: self._run_task(n, c, o))
                for picture in sorted(workspace.inside(out).glob("*.png")):
                    ui.link(picture.name, f"/results/{DESIGNS}/{out.name}/{picture.name}", new_tab=True)

    def _run_task(self, name: str, command: str, out: Path) -> None:
        self._page.attempt(lambda: self._page.session.run_design_task(command, name, str(out)))
        self._page.show_state()
