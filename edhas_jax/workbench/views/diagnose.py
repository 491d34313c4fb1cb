"""Diagnose: calibrate and search for missing effects as jobs; suspects as cards that one tries, adds or rejects."""

from nicegui import ui

from edhas_jax.workbench.figures import waterfall_figure
from edhas_jax.workbench.standing import BENCH_CORRECTED, sizes_text
from edhas_jax.workbench.views.job_panel import JobPanel
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.suspects import Suspects


class DiagnoseView:
    """Jobs, verdict, waterfall, suspects, what was tried."""

    def __init__(self, page):
        self._page = page

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-center gap-3"):
            ui.button("Calibrate", on_click=self._calibrate).props("no-caps unelevated icon=straighten")
            ui.button("Diagnose", on_click=self._diagnose).props("no-caps unelevated icon=troubleshoot")
            ui.label("in a process of its own; it goes on when this page is closed").classes("wb-quiet gt-xs")
        self._job = JobPanel(self._page, {"calibrate": self._calibrate, "diagnose": self._diagnose})
        with ui.element("div").classes("wb-two mt-3"):
            self._verdict = ui.column().classes("gap-2 w-full")
            with ui.column().classes("gap-0 w-full"):
                ui.label("Residual over noise after each stage").classes("wb-h")
                self._which = ui.label("").classes("wb-quiet")
                self._waterfall = Plot("waterfall")
        self._suspects = Suspects(self._page, self.refresh)
        self._tried = ui.column().classes("w-full gap-1 mt-4")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self.show_progress()
        self._draw_waterfall()
        self._build_verdict()
        self._suspects.refresh()
        self._build_tried()

    def show_progress(self) -> None:
        """Show what the job that runs has reported."""
        self._job.refresh()

    async def redraw(self) -> None:
        """Draw the plot again, in the colours of the page."""
        self._draw_waterfall()

    def _calibrate(self) -> None:
        self._start(self._page.session.calibrate)

    def _diagnose(self) -> None:
        self._start(self._page.session.diagnose)

    def _start(self, start) -> None:
        if self._page.summary is None:
            self._page.tell(
                "\n".join(self._page.problems) or "There is no campaign in this folder yet: bring data first."
            )
            return
        self._page.attempt(start)
        self._page.show_state()
        self.show_progress()

    def _draw_waterfall(self) -> None:
        now = self._page.standing()
        names = ", ".join(stage for stage in now.stages if stage in now.corrected)
        note = f"{BENCH_CORRECTED.capitalize()}: {names}. “Compare” does not correct it."
        self._which.set_text(note if names else "")
        if now.stages:
            self._waterfall.show(waterfall_figure(now.stages, self._page.dark))
        else:
            self._waterfall.hide()

    def _build_verdict(self) -> None:
        now = self._page.standing()
        self._verdict.clear()
        with self._verdict:
            ui.label("Verdict").classes("wb-h")
            if not now.verdict:
                ui.label("A diagnosis has not been made yet. It calibrates the model, tries what the library has, and "
                         "says what is missing, where, and how certain that is.").classes("wb-quiet")  # fmt: skip
                return
            box = ui.column().classes("gap-1 wb-verdict" + (" fine" if now.is_fine else ""))
            with box.props("data-mark=verdict"):
                for sentence in now.verdict:
                    ui.label(sentence)
            if now.before:
                earlier = ui.expansion("what the diagnosis said of the model before").classes("w-full wb-quiet")
                with earlier.props("dense data-mark=verdict-before"):
                    for sentence in now.before:
                        ui.label(sentence)

    def _build_tried(self) -> None:
        """The models that were tried, side by side."""
        rows = self._page.workspace.tried()
        self._tried.clear()
        if not rows:
            return
        with self._tried:
            ui.label("What was tried, side by side").classes("wb-h")
            heads = "model", "runs used", "runs not used", "sizes"
            with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-table"):
                with ui.element("tr"):
                    for head in heads:
                        with ui.element("th").classes("n" if head.startswith("runs") else ""):
                            ui.label(head)
                best = sorted(rows.items(), key=lambda item: item[1]["error"].get("holdout") or item[1]["error"]["fit"])
                for name, row in best:
                    with ui.element("tr"):
                        texts = [
                            name.replace("_", " "),
                            *(_error(row["error"].get(u)) for u in ("fit", "holdout")),
                            sizes_text(row["parameters"]).replace("_", " "),
                        ]
                        for head, text in zip(heads, texts, strict=True):
                            with ui.element("td").classes("n" if head.startswith("runs") else ""):
                                ui.label(text)


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
