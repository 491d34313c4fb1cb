"""Diagnose: calibrate and search for missing effects as jobs; suspects as cards that one tries, adds or rejects."""

from nicegui import ui

from edhas_jax.workbench.figures import waterfall_figure
from edhas_jax.workbench.views.job_panel import JobPanel
from edhas_jax.workbench.views.plot import Plot
from edhas_jax.workbench.views.suspects import Suspects, candidate_name, sizes_text
from edhas_jax.workbench.workspace import DIAGNOSED

VERDICTS = {
    "adequate": "Nothing is missing that these runs show.",
    "missing_effect": "Missing in the model:",
    "ambiguous": "Missing in the model, but another effect explains the runs nearly as well:",
    "unknown_effect": "Something is missing that no effect of the library explains.",
}


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
        stages = self._page.stages()
        diagnosis = self._page.workspace.result(DIAGNOSED)
        if diagnosis is not None and diagnosis.get("effects"):
            after = {use: row.get("overall") for use, row in diagnosis["error"]["after"].items()}
            stages["diagnosed: " + " + ".join(diagnosis["effects"])] = after
        if stages:
            self._waterfall.show(waterfall_figure(stages, self._page.dark))
        else:
            self._waterfall.hide()

    def _build_verdict(self) -> None:
        diagnosis = self._page.workspace.result(DIAGNOSED)
        self._verdict.clear()
        with self._verdict:
            ui.label("Verdict").classes("wb-h")
            if diagnosis is None:
                ui.label("A diagnosis has not been made yet. It calibrates the model, tries what the library has, and "
                         "says what is missing, where, and how certain that is.").classes("wb-quiet")  # fmt: skip
                return
            verdict = diagnosis["verdict"]
            box = ui.column().classes("gap-1 wb-verdict" + (" fine" if verdict == "adequate" else ""))
            with box.props("data-mark=verdict"):
                little = "The cause was not found. What explains most of it, but little:"
                ui.label(little if diagnosis.get("explains_little") else VERDICTS.get(verdict, verdict))
                if diagnosis.get("left"):
                    ui.label(diagnosis["left"])
                for row in diagnosis["candidates"]:
                    if row["accepted"]:
                        ui.label(f"{candidate_name(row)}: {sizes_text(row['parameters'])}").classes("font-semibold")
                if (form := diagnosis.get("form")) is not None:
                    ui.label(f"What explains most of it: {form['formula']}").classes("font-semibold")
            errors = diagnosis["error"]
            use = "holdout" if errors["after"]["holdout"] else "fit"
            values = [errors[state][use]["overall"] for state in ("before", "calibrated", "after")]
            runs = "runs not used" if use == "holdout" else "runs used"
            ui.label(f"Residual over noise on the {runs}: {values[0]:.2f} as given, {values[1]:.2f} calibrated, "
                     f"{values[2]:.2f} with what was found.")  # fmt: skip
            members = [name for name in diagnosis["answer"]["set"]]
            if len(members) > 1:
                p = diagnosis["answer"]["probabilities"]
                ui.label("Not ruled out: " + ", ".join(f"{m} {p.get(m, 0.0):.2f}" for m in members))
            for key in ("holdout_split",):
                if diagnosis.get(key):
                    ui.label(diagnosis[key]).classes("wb-quiet")

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
                            sizes_text(row["parameters"]),
                        ]
                        for head, text in zip(heads, texts, strict=True):
                            with ui.element("td").classes("n" if head.startswith("runs") else ""):
                                ui.label(text)


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
