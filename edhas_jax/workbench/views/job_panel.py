"""The job that runs or ran last, with its progress, and the buttons to cancel and to resume it."""

from collections.abc import Callable, Mapping

from nicegui import ui

from edhas_jax.workbench.jobs import CANCELLED, DONE, FAILED, RUNNING, Job
from edhas_jax.workbench.views.elements import Block, Button

STATES = {
    RUNNING: "runs", DONE: "is done", FAILED: "has failed", CANCELLED: "was cancelled; finished parts are kept",
}  # fmt: skip
STOPPED = "was stopped"
CHANGED = "{} changed after this has begun: its result will be that of the campaign as it was."
MAX_REPORTS = 14
MAX_OUTPUT = 3000  # characters of a job that has failed


class JobPanel:
    """The last of some kinds of jobs.

    Args:
        page: the window.
        starts: starts a job again, by its title.
        stops: whether a job that is interrupted is not resumed: it ends with the best that it has found.
    """

    def __init__(self, page, starts: Mapping[str, Callable], stops: bool = False):
        self._page, self._starts, self._stops = page, starts, stops
        self._shown: tuple[int, str] | None = None
        self._reports = 0  # number of progress reports shown
        self._body = ui.column().classes("w-full gap-1 mt-2").props("data-mark=job")

    def refresh(self) -> None:
        """Show the last job, if it has changed."""
        jobs = [job for job in self._page.session.jobs.all() if job.title in self._starts]
        if not jobs:
            return
        job = jobs[-1]
        if (job.number, job.status) != self._shown:
            self._shown, self._reports = (job.number, job.status), 0
            self._body.clear()
            with self._body:
                self._build(job)
        self._update(job)

    def _update(self, job: Job) -> None:
        """Update time and log; the buttons stay, because a click on one that is replaced at that moment is lost."""
        state = STOPPED if self._stops and job.status == CANCELLED else STATES[job.status]
        self._title.set_text(f"“{job.title}” {state} · {job.seconds:.0f} s")
        changed = self._page.workspace.changed_inputs(job.inputs) if job.status == RUNNING else []
        self._changed.set_text(CHANGED.format(" and ".join(changed)) if changed else "")
        rows = self._page.session.jobs.progress(job) if job.status in (RUNNING, CANCELLED) else []
        if len(rows) == self._reports:
            return
        self._reports = len(rows)
        self._log.clear()
        with self._log:
            if "share" in rows[-1]:
                ui.linear_progress(rows[-1]["share"], show_value=False).classes("w-full")
            with ui.element("div").classes("wb-log"):
                for row in reversed(rows[-MAX_REPORTS:]):
                    ui.label(f"{max(row.get('at', 0.0) - job.began, 0.0):.0f} s: {row['what']}")

    def _build(self, job: Job) -> None:
        jobs = self._page.session.jobs
        with ui.row().classes("items-center gap-3"):
            if job.status == RUNNING:
                ui.spinner(size="sm")
            self._title = ui.label().props(f"data-mark=job-{job.status}")
            if job.status == RUNNING:
                cancel = Button("Stop" if self._stops else "Cancel", on_click=lambda: jobs.cancel(job))
                cancel.props("data-mark=cancel-job")
            elif job.status == CANCELLED and not self._stops:
                Button("Resume", on_click=self._starts[job.title], icon="play_arrow")
        self._changed = ui.label("").props("data-mark=job-changed")
        self._log = ui.column().classes("w-full gap-1")
        if job.status == FAILED:
            Block(jobs.output(job)[-MAX_OUTPUT:])
        elif job.status == DONE:
            with ui.expansion("what the command printed").classes("w-full wb-quiet").props("dense"):
                Block(jobs.output(job)).classes("wb-output")
