"""Overview: where the model stands, at one glance."""

import asyncio
import math
from typing import Any

from nicegui import ui

from edhas_jax.measurements.fitted_model import BENCH_CORRECTED
from edhas_jax.workbench.calculator import CalculationCancelled, CalculationError
from edhas_jax.workbench.figures import staircase_figure, traces_figure
from edhas_jax.workbench.views.elements import Button, Head, Quiet, Strong
from edhas_jax.workbench.views.matrix import error_matrix, matrix_rows
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.save import save_button, save_csv
from edhas_jax.workbench.views.schematic import Schematic

REPLAY = "set_point"
INTERVALS = 500  # into which the plot is divided when a record is thinned
EVERYTHING = float("-inf"), float("inf")


class OverviewView:
    """Matrices of the first, the calibrated and the last model, staircase of the error, worst signal, machine."""

    def __init__(self, page):
        self._page = page
        self._stages: Any = None  # what the staircase shows
        self._of: Any = None  # what the matrices are made of
        self._found: dict[str, dict] = {}  # comparison by stage
        self._overlaid: Any = None
        self._turn = asyncio.Lock()  # folder and clicks may ask at the same time

    async def build(self) -> None:
        """Build the view."""
        with ui.element("div").classes("wb-two wb-glance"):
            with ui.column().classes("gap-1 w-full"):
                with ui.row().classes("items-center gap-1"):
                    Head("Residual over noise by run and signal")
                    formats = {s.upper(): lambda s=s: self._save_picture(s) for s in ("png", "svg")}
                    save_button("matrices", formats | {"CSV": self._save_csv})
                self._note = Quiet()
                self._matrices = ui.row().classes("gap-x-3 gap-y-3 items-start")
            with ui.column().classes("gap-0 w-full"):
                Head("Residual over noise after each stage")
                self._of_stages = Quiet().props("data-mark=stages")
                self._staircase = Plot("staircase", samples=self._staircase_rows)
            with ui.column().classes("gap-0 w-full"):
                with ui.row().classes("items-center gap-3"):
                    self._title = Head().props("data-mark=overlaid")
                    Button("Compare", on_click=lambda: self._page.go(view="Compare"), icon="show_chart")
                self._plot = Plot("overlay", samples=self._samples)
            with ui.column().classes("gap-0 w-full"):
                Head("Where something is missing")
                self._schematic = Schematic(self._page, lambda part: self._page.go(view="Machine", part=part))
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder and the place."""
        await self.show_progress()
        self._schematic.refresh()
        async with self._turn:
            await self._compare()
            await self._overlay()

    async def show_progress(self) -> None:
        """Let the staircase grow with the search that runs."""
        now = self._page.standing()
        stages = now.growing or now.stages
        text = "Dashed: the noise of the sensors."
        if now.growing:
            text = "The diagnosis that runs has come so far:"
        elif not stages:
            text = "Calibrate or diagnose, and it is seen here how the error falls."
        elif now.corrected:
            text += f" {BENCH_CORRECTED.capitalize()}: {', '.join(n for n in stages if n in now.corrected)}."
        self._of_stages.set_text(text)
        if (stages, self._page.dark) == self._stages:
            return
        self._stages = stages, self._page.dark
        if stages:
            self._staircase.show(staircase_figure(stages, self._page.dark))
        else:
            self._staircase.hide()

    async def _compare(self) -> None:
        """Compare the first, the calibrated and the last model, if one of them has changed."""
        page = self._page
        models, paths = page.standing().last_models, page.workspace.models()
        written = [None if paths.get(m) is None else paths[m].stat().st_mtime_ns for m in models.values()]
        of = models, written, page.readings
        if of == self._of:
            return
        self._of, found, notes = of, {}, page.missing
        for stage, model in () if notes else models.items():
            try:
                found[stage] = await page.session.calculator.call("campaign.compare", model, REPLAY, say=page.say)
            except (CalculationError, CalculationCancelled) as error:
                notes.append(f"{stage}: {error or 'cancelled'}")
        page.say("")
        self._found, self._overlaid = found, None
        note = "1 is the noise of the sensors; ▲ is worse than in the matrix before. Click a cell to see its signal."
        if page.standing().corrected:
            note += f" The cells are as recorded, not {BENCH_CORRECTED}."
        self._note.set_text("\n".join(notes) or note)
        self._build_matrices()

    def _build_matrices(self) -> None:
        self._matrices.clear()
        before = None
        with self._matrices:
            for stage, found in self._found.items():
                with ui.column().classes("gap-0").props(f"data-mark='matrix-{stage.strip('+ ')}'"):
                    Strong(stage.replace("_", " "))
                    error_matrix(found["matrix"], list(found["signals"]), self._page.summary["conditions"],
                                 self._click_cell, before, is_small=True)  # fmt: skip
                before = found["matrix"]

    async def _click_cell(self, run: str, signal: str) -> None:
        self._page.move(run=run, signal=signal)
        async with self._turn:
            await self._overlay()
        self._plot.bring_into_view()

    def _before(self) -> dict[str, Any]:
        """The comparison of the last model without effects."""
        return self._found.get("calibrated") or next(iter(self._found.values()))

    def _worst_cell(self) -> tuple[str, str]:
        """Run and signal of the largest error on the runs by which all is judged."""
        matrix, runs, use = self._before()["matrix"], self._page.summary["runs"], self._page.standing().use
        judged = [run for run in matrix if runs[run]["use"] == use] or list(matrix)
        cells = [(value, run, name) for run in judged for name, value in matrix[run].items()]
        return max(cells, key=lambda cell: (math.isfinite(cell[0]), cell[0]))[1:]

    def _overlaid_cell(self) -> tuple[str, str]:
        """Run and signal that are drawn: those that were chosen, otherwise the worst."""
        matrix, place = self._before()["matrix"], self._page.place
        run, signal = self._worst_cell()
        run = place.run if place.run in matrix else run
        signal = place.signal if place.signal in matrix[run] else signal
        return run, signal if signal in matrix[run] else next(iter(matrix[run]))

    async def _overlay(self) -> None:
        """Draw the signal with the model before the effects and with the last one."""
        if not self._found:
            self._title.set_text("")
            self._plot.hide()
            return
        page, cell = self._page, self._overlaid_cell()
        page.shown = cell
        if (cell, page.dark) == self._overlaid:
            return
        self._title.set_text("The worst signal" if cell == self._worst_cell() else "The chosen signal")
        of = self._overlaid_models(), REPLAY, [cell], *EVERYTHING, INTERVALS
        panels = await page.ask("campaign.traces", *of)
        if panels:
            stages = {model: stage for stage, model in page.standing().models.items()}
            panels = [p | {"models": {stages.get(n, n): m for n, m in p["models"].items()}} for p in panels]
            places = [row["range"] for row in self._before()["sentences"] if (row["run"], row["signal"]) == cell]
            self._plot.show(traces_figure(panels, page.dark, next(iter(places), None)))
            self._overlaid = cell, page.dark

    def _overlaid_models(self) -> list[str]:
        models = self._page.standing().models
        stages = ["calibrated" if "calibrated" in self._found else next(iter(self._found)), list(self._found)[-1]]
        return list(dict.fromkeys(models[stage] for stage in stages))

    async def _samples(self) -> list[list] | None:
        run, signal = self._overlaid_cell()
        return await self._page.ask("campaign.samples", self._overlaid_models(), REPLAY, run, [signal])

    async def _staircase_rows(self) -> list[tuple]:
        now = self._page.standing()
        rows = [(name, use, value) for name, row in (now.growing or now.stages).items() for use, value in row.items()]
        return [("stage", "runs", "residual_over_noise"), *rows]

    def _save_csv(self) -> None:
        save_csv("matrices", matrix_rows({stage: found["matrix"] for stage, found in self._found.items()}))

    async def _save_picture(self, suffix: str) -> None:
        panels = {stage: found["matrix"] for stage, found in self._found.items()}
        picture = await self._page.ask("campaign.matrix_picture", panels, suffix) if panels else None
        if picture is not None:
            ui.download.content(picture, f"matrices.{suffix}")
