"""Diagnose: search for missing effects as a job; suspects as cards that one tries, adds or rejects."""

from nicegui import ui

from edhas_jax.workbench.standing import sizes_text
from edhas_jax.workbench.views.job_panel import JobPanel
from edhas_jax.workbench.views.save import csv_button
from edhas_jax.workbench.views.suspects import Suspects
from edhas_jax.workbench.views.table import show_table


class DiagnoseView:
    """Job, suspects, what was tried."""

    def __init__(self, page):
        self._page = page

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-center gap-3"):
            ui.button("Diagnose", on_click=self._diagnose).props("no-caps unelevated icon=troubleshoot")
            ui.label("in a process of its own; it goes on when this page is closed").classes("wb-quiet gt-xs")
        self._job = JobPanel(self._page, {"diagnose": self._diagnose})
        self._suspects = Suspects(self._page, self.refresh)
        self._tried = ui.column().classes("w-full gap-1 mt-4")
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        await self.show_progress()
        self._suspects.refresh()
        self._build_tried()

    async def show_progress(self) -> None:
        """Show what the job that runs has reported."""
        self._job.refresh()

    async def redraw(self) -> None:
        """Nothing to draw."""

    async def _diagnose(self) -> None:
        page = self._page
        if page.summary is None:
            page.tell("\n".join(page.problems) or "There is no campaign in this folder yet: bring data first.")
            return
        page.attempt(page.session.diagnose)
        page.show_state()
        await self.show_progress()

    def _build_tried(self) -> None:
        """The models that were tried, side by side."""
        rows = self._page.workspace.tried()
        self._tried.clear()
        if not rows:
            return
        best = sorted(rows.items(), key=lambda item: item[1]["error"].get("holdout") or item[1]["error"]["fit"])
        table = [
            (name.replace("_", " "), *(_error(row["error"].get(use)) for use in ("fit", "holdout")),
             sizes_text(row["parameters"]).replace("_", " "))
            for name, row in best
        ]  # fmt: skip
        heads = "model", "runs used", "runs not used", "sizes"
        with self._tried:
            with ui.row().classes("items-center gap-1"):
                ui.label("What was tried, side by side").classes("wb-h")
                csv_button("tried", lambda: [heads, *table])
            show_table(heads, table, heads[1:3])


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
