"""The job that runs or ran last, with its progress, and the buttons to cancel and to resume it."""

from collections.abc import Callable, Mapping
from typing import Any

from nicegui import ui

from edhas_jax.workbench.jobs import CANCELLED, DONE, FAILED, RUNNING, Job

STATES = {
    RUNNING: "runs", DONE: "is done", FAILED: "has failed", CANCELLED: "was cancelled; finished parts are kept",
}  # fmt: skip
MAX_REPORTS = 14
MAX_OUTPUT = 3000  # characters of a job that has failed


class JobPanel:
    """The last of some kinds of jobs.

    Args:
        page: the window.
        starts: starts a job again, by its title.
    """

    def __init__(self, page, starts: Mapping[str, Callable[[], None]]):
        self._page, self._starts = page, starts
        self._shown: tuple | None = None
        self._body = ui.column().classes("w-full gap-1 mt-2").props("data-mark=job")

    def refresh(self) -> None:
        """Show the last job, if it has changed."""
        jobs = [job for job in self._page.session.jobs.all() if job.title in self._starts]
        if not jobs:
            return
        job = jobs[-1]
        rows = self._page.session.jobs.progress(job)
        shown = job.number, job.status, len(rows), int(job.seconds) if job.status == RUNNING else 0
        if shown != self._shown:
            self._shown = shown
            self._body.clear()
            with self._body:
                self._build(job, rows)

    def _build(self, job: Job, rows: list[dict[str, Any]]) -> None:
        jobs = self._page.session.jobs
        with ui.row().classes("items-center gap-3"):
            if job.status == RUNNING:
                ui.spinner(size="sm")
            what = f"“{job.title}” {STATES[job.status]} · {job.seconds:.0f} s"
            ui.label(what).props(f"data-mark=job-{job.status}")
            if job.status == RUNNING:
                ui.button("Cancel", on_click=lambda: jobs.cancel(job)).props("no-caps flat dense data-mark=cancel-job")
            elif job.status == CANCELLED:
                ui.button("Resume", on_click=self._starts[job.title]).props("no-caps flat dense icon=play_arrow")
        if rows and job.status in (RUNNING, CANCELLED):
            if "share" in rows[-1]:
                ui.linear_progress(rows[-1]["share"], show_value=False).classes("w-full")
            with ui.element("div").classes("wb-log"):
                for row in reversed(rows[-MAX_REPORTS:]):
                    ui.label(f"{max(row.get('at', 0.0) - job.began, 0.0):.0f} s: {row['what']}")
        if job.status == FAILED:
            ui.label(jobs.output(job)[-MAX_OUTPUT:]).classes("wb-block")
        elif job.status == DONE:
            with ui.expansion("what the command printed").classes("w-full wb-quiet").props("dense"):
                ui.label(jobs.output(job)).classes("wb-block wb-output")
