"""Compare: where a model deviates from the measurements."""

from typing import Any

from nicegui import ui

from edhas_jax.machine.rigs import RIGS
from edhas_jax.measurements.fitted_model import BENCH_CORRECTED
from edhas_jax.measurements.residual_matrix import ERROR_LABEL
from edhas_jax.workbench.figures import residual_figure, traces_figure
from edhas_jax.workbench.standing import USES
from edhas_jax.workbench.views.elements import Button, Choice, Head, Quiet, Toggle
from edhas_jax.workbench.views.matrix import error_matrix, matrix_rows
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.save import csv_button
from edhas_jax.workbench.workspace import AS_GIVEN

REPLAYS = {
    "set_point": "set point", "voltage": "measured voltage", "current": "measured current",
    "piston_position": "measured position",
}  # fmt: skip
NO_OTHER = "none"  # no second model
ONE_RUN, ONE_SIGNAL = "signals of one run", "runs of one signal"
INTERVALS = 500  # into which a plot is divided when a record is thinned
MAX_PANELS = 10
MAX_REMARKS = 12


class CompareView:
    """Matrix of errors, sentences, measured over modelled, residual over any variable."""

    def __init__(self, page):
        self._page = page
        self._model, self._other, self._replay = AS_GIVEN, NO_OTHER, "set_point"
        self._run, self._signal, self._mode = "", "", ONE_RUN
        self._found: dict[str, Any] | None = None
        self._panels: list[dict] = []
        self._shown: list[float] | None = None
        self._variable, self._is_dark = "", False

    async def build(self) -> None:
        """Build the view."""
        page = self._page
        models = page.workspace.models()
        last = list(page.standing().models.values() or [AS_GIVEN])[-1]
        self._model = page.place.model if page.place.model in models else last
        with ui.row().classes("items-end gap-4"):
            self._models = Choice(list(models), value=self._model, label="model", on_change=self._choose)
            self._others = Choice(
                [NO_OTHER, *models], value=self._other, label="over another model", on_change=self._choose
            )
            for choice in (self._models, self._others):
                choice.classes("min-w-48")
            self._replays = Choice(REPLAYS, value=self._replay, label="driven by", on_change=self._choose)
            self._replays.classes("min-w-40")
            Button("Report of this comparison", on_click=self._report, icon="description")
        self._body = ui.column().classes("w-full gap-3 mt-3")
        await self._compare()

    async def refresh(self) -> None:
        """Follow the folder and the place: new models, a changed campaign, another run, signal or model."""
        models, place = list(self._page.workspace.models()), self._page.place
        self._model = self._models.follow(models, place.model, self._model, AS_GIVEN)
        self._other = self._others.follow([NO_OTHER, *models], self._other, NO_OTHER)
        if self._found is None or self._found.get("of") != self._identity():
            await self._compare()
        elif self._follow_place() or self._is_dark != self._page.dark:
            await self._draw()
            await self._draw_residual()

    def _follow_place(self) -> bool:
        """Take over run and signal of the place; whether they are others."""
        old, place, matrix = (self._run, self._signal), self._page.place, self._found["matrix"]
        self._run = place.run if place.run in matrix else self._run
        self._signal = place.signal if place.signal in self._found["signals"] else self._signal
        if (self._run, self._signal) == old:
            return False
        self._shown = None
        return True

    def _identity(self) -> tuple:
        paths = [self._page.workspace.models().get(model) for model in self._overlaid()]
        changed = [path.stat().st_mtime_ns if path is not None and path.is_file() else 0 for path in paths]
        return self._overlaid(), self._replay, changed, self._page.readings

    def _overlaid(self) -> list[str]:
        """The models that are drawn, the one that is compared last."""
        return [self._model] if self._other in (NO_OTHER, self._model) else [self._other, self._model]

    async def _choose(self) -> None:
        """Take over the models and what drives them."""
        old = self._model, self._other, self._replay
        self._model, self._other, self._replay = self._models.value, self._others.value, self._replays.value
        if self._model != old[0]:
            self._page.move(model=self._model)
        if (self._model, self._other, self._replay) != old:
            await self._compare()

    def _report(self) -> None:
        self._page.attempt(lambda: self._page.session.report_comparison(self._model))
        self._page.note("The report is being written; the view “Report” shows it.")

    async def _compare(self) -> None:
        page = self._page
        self._body.clear()
        if page.missing:
            with self._body:
                for line in page.missing:
                    ui.label(line)
            return
        self._replays.set_visibility(page.summary["rig"] in RIGS)  # the drives of one's own rig are in its records
        of, overlaid = self._identity(), self._overlaid()
        found = await page.ask("campaign.compare", self._model, self._replay)
        if found is None:
            self._found = None
            return
        before = None
        if len(overlaid) > 1:
            before = await page.ask("campaign.compare", overlaid[0], self._replay)
        if of != self._identity():  # something else was chosen meanwhile, and its comparison follows
            return
        self._body.clear()
        self._found = found | {"of": of, "before": None if before is None else before["matrix"]}
        page.did("compare", page.session.command_compare(self._model, self._replay),
                 page.session.python_compare(self._model))  # fmt: skip
        signals, matrix = list(found["signals"]), found["matrix"]
        self._run = self._run if self._run in matrix else next(iter(matrix))
        self._signal = self._signal if self._signal in signals else self._worst_signal()
        self._follow_place()
        if self._variable not in found["variables"]:  # the one that the first sentence speaks of
            self._variable = next((row["axis"] for row in found["sentences"]), "time")
        with self._body:
            self._build_body()
        await self._draw()
        await self._draw_residual()

    def _worst_signal(self) -> str:
        rows = [(value, name) for row in self._found["matrix"].values() for name, value in row.items()]
        return max(rows)[1]

    def _build_body(self) -> None:
        found, page = self._found, self._page
        with ui.element("div").classes("wb-two"):
            with ui.column().classes("gap-1"):
                with ui.row().classes("items-center gap-1"):
                    Head("Residual over noise")
                    csv_button("matrix", self._matrix_rows)
                note = "1 is the noise of the sensors. Click a cell to see the signal."
                if found["before"] is not None:
                    note = f"“{self._other}” → “{self._model}”; ▲ is worse. {note}"
                Quiet(note)
                if (note := self._bench_note()) is not None:
                    Quiet(note).props("data-mark=bench-note")
                notes = page.summary["conditions"]
                with ui.element("div").props("data-mark=as-recorded"):
                    error_matrix(found["matrix"], list(found["signals"]), notes, self._look_at, found["before"])
                if found["bench_corrected"]:
                    Head(f"Residual over noise {BENCH_CORRECTED}")
                    with ui.element("div").props("data-mark=bench-corrected"):
                        error_matrix(found["bench_corrected"], list(found["signals"]), notes, self._look_at)
            with ui.column().classes("gap-1"):
                Head("Where the model deviates")
                if not found["sentences"]:
                    ui.label("Nowhere: the residuals hold nothing but the noise of the sensors.")
                with ui.element("ol").classes("wb-list"):
                    for row in found["sentences"]:
                        with ui.element("li"):
                            link = ui.element("button").classes("wb-sentence").props("type=button")
                            with link:
                                ui.label(row["text"])
                            link.on("click", lambda _, row=row: self._show_place(row))
                remarks = [*page.summary["sentences"], *found["remarks"]][:MAX_REMARKS]
                for remark in remarks:
                    Quiet(remark)
        with ui.row().classes("items-center gap-4 w-full"):
            Head("Measured and model")
            self._modes = Toggle([ONE_RUN, ONE_SIGNAL], value=self._mode, on_change=self._whole)
            self._which = Choice([], on_change=self._choose_which).classes("min-w-40")
            Button("Whole record", on_click=self._whole, icon="zoom_out_map").props("size=sm")
            Quiet(f"Drag to zoom; all panels follow. Below each signal: {ERROR_LABEL}, band ± 2.").classes("gt-sm")
        self._plot = Plot("traces", {"plotly_relayout": self._zoomed}, self._samples)
        with ui.row().classes("items-center gap-4 w-full"):
            Head(f"{ERROR_LABEL} over")
            self._variables = Choice(found["variables"], value=self._variable, on_change=self._choose_variable)
        self._over = Plot("over")

    def _matrix_rows(self) -> list[tuple]:
        before = {} if self._found["before"] is None else {self._other: self._found["before"]}
        return matrix_rows(before | {self._model: self._found["matrix"]})

    def _bench_note(self) -> str | None:
        """Why the errors differ from those above the page; None where the bench is not corrected there either."""
        now = self._page.standing()
        stage = next((stage for stage, model in now.models.items() if model == self._model), None)
        if stage not in now.corrected:
            return None
        return (
            "What the bench did (triggers, settings, sensors) is not corrected here. Corrected, the residual over "
            f"noise on the {USES[now.use]} is {now.judged(stage):.2f}."
        )

    async def _show_place(self, row: dict[str, Any]) -> None:
        if row["axis"] in self._found["variables"]:
            self._variable = row["axis"]
            self._variables.set_value(self._variable)
        await self._look_at(row["run"], row["signal"], list(row["range"]))

    async def _look_at(
        self, run: str, signal: str, shown: list[float] | None = None, scrolls: bool = True
    ) -> None:  # fmt: skip
        """Draw a run and a signal, and bring the plot into view."""
        self._run, self._signal, self._shown = run, signal, shown
        self._page.move(run=run, signal=signal)
        await self._draw()
        if scrolls:
            self._plot.bring_into_view()
        await self._draw_residual()

    async def _choose_which(self, event) -> None:
        cell = (event.value, self._signal) if self._mode == ONE_RUN else (self._run, event.value)
        if cell != (self._run, self._signal):
            await self._look_at(*cell, scrolls=False)

    async def _choose_variable(self, event) -> None:
        if event.value != self._variable:
            self._variable = event.value
            await self._draw_residual()

    async def _whole(self) -> None:
        """Draw the runs from their beginning to their end."""
        self._mode, self._shown = self._modes.value, None
        await self._draw()

    def _panel_names(self) -> list[tuple[str, str]]:
        matrix = self._found["matrix"]
        if self._mode == ONE_SIGNAL:
            return [(run, self._signal) for run, row in matrix.items() if self._signal in row][:MAX_PANELS]
        names = sorted(matrix[self._run], key=lambda name: name != self._signal)  # the chosen one on top
        return [(self._run, name) for name in names][:MAX_PANELS]

    async def _draw(self) -> None:
        options = list(self._found["matrix"]) if self._mode == ONE_RUN else list(self._found["signals"])
        self._page.shown, self._is_dark = (self._run, self._signal), self._page.dark
        self._which.follow(options, self._run if self._mode == ONE_RUN else self._signal)
        panels = await self._traces()
        if panels:
            self._panels = panels
            self._plot.show(traces_figure(panels, self._page.dark, self._shown))

    async def _traces(self) -> list[dict] | None:
        of = self._panel_names(), *(self._shown or (float("-inf"), float("inf"))), INTERVALS
        return await self._page.ask("campaign.traces", self._overlaid(), self._replay, *of)

    async def _samples(self) -> list[list] | None:
        """All samples of the run that is drawn, as a table with its head."""
        signals = list(self._found["matrix"][self._run])
        return await self._page.ask("campaign.samples", self._overlaid(), self._replay, self._run, signals)

    async def _zoomed(self, event) -> None:
        """Fetch the samples of a part of a long record; short ones are complete in the plot already."""
        args = event.args if isinstance(event.args, dict) else {}
        if args.get("xaxis.autorange"):
            self._shown = None
        elif "xaxis.range[0]" in args:
            self._shown = [float(args["xaxis.range[0]"]), float(args["xaxis.range[1]"])]
        else:
            return
        if all(panel["samples"] <= 2 * INTERVALS for panel in self._panels):
            return
        panels = await self._traces()
        if panels:
            figure = traces_figure(panels, self._page.dark, self._shown)
            values = {"x": [row["x"] for row in figure["data"]], "y": [row["y"] for row in figure["data"]]}
            self._plot.element.run_plot_method("restyle", values, list(range(len(figure["data"]))))

    async def _draw_residual(self) -> None:
        of = self._model, self._replay, self._signal, self._variable
        found = await self._page.ask("campaign.residual_over", *of)
        if found is not None:
            self._over.show(residual_figure(found, self._signal, self._variable, self._page.dark))
