"""Diagnose: search for missing effects as a job; suspects as cards that one tries, adds or rejects."""

from nicegui import ui

from edhas_jax.workbench.standing import sizes_text
from edhas_jax.workbench.views.elements import Head, MainButton, Quiet
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
            MainButton("Diagnose", on_click=self._diagnose, icon="troubleshoot")
            Quiet("in a process of its own; it goes on when this page is closed").classes("gt-xs")
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

    async def _diagnose(self) -> None:
        page = self._page
        if not page.has_campaign():
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
                Head("What was tried, side by side")
                csv_button("tried", lambda: [heads, *table])
            show_table(heads, table, heads[1:3])


def _error(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"
