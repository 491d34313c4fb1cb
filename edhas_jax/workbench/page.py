"""The page: one window on the workbench, with a view for each part of the loop."""

import dataclasses
import html
import json
from collections.abc import Callable
from typing import Any

from nicegui import ui

from edhas_jax.measurements.fitted_model import BENCH_CORRECTED
from edhas_jax.workbench.calculator import CalculationCancelled, CalculationError
from edhas_jax.workbench.connection import watch_script
from edhas_jax.workbench.jobs import RUNNING
from edhas_jax.workbench.keys import HELP, NEXT_RUN, NEXT_SIGNAL, PREVIOUS_RUN, PREVIOUS_SIGNAL, neighbour, show_keys
from edhas_jax.workbench.place import Place
from edhas_jax.workbench.session import Session
from edhas_jax.workbench.standing import USES, Standing, standing
from edhas_jax.workbench.style import CSS, PRIMARY
from edhas_jax.workbench.views.calibrate import CalibrateView
from edhas_jax.workbench.views.compare import CompareView
from edhas_jax.workbench.views.data import DataView
from edhas_jax.workbench.views.design import DesignView
from edhas_jax.workbench.views.diagnose import DiagnoseView
from edhas_jax.workbench.views.elements import Button, bullets, dialog
from edhas_jax.workbench.views.machine import MachineView
from edhas_jax.workbench.views.overview import OverviewView
from edhas_jax.workbench.views.report import ReportView
from edhas_jax.workbench.views.steps import StepsView
from edhas_jax.workbench.views.verdict import Verdict
from edhas_jax.workbench.workspace import WorkspaceError

PATIENCE = 300.0  # s, with a browser on a busy computer
POLL = 1.0  # s, between two looks whether the folder has changed
MAX_LISTED_PROBLEMS = 40
# by name: the view, its icon, and how the steps begin that made what it shows
VIEWS: dict[str, tuple[type, str, tuple[str, ...]]] = {
    "Overview": (OverviewView, "dashboard", ("calibrate", "diagnose", "try")),
    "Data": (DataView, "upload_file", ("write campaign", "change campaign")),
    "Compare": (CompareView, "show_chart", ("compare",)),
    "Calibrate": (CalibrateView, "straighten", ("calibrate", "keep")),
    "Diagnose": (DiagnoseView, "troubleshoot", ("diagnose", "try")),
    "Machine": (MachineView, "precision_manufacturing", ("diagnose", "try")),
    "Report": (ReportView, "description", ("calibrate", "diagnose", "report")),
    "Design": (DesignView, "tune", ("simulate", "sweep", "size", "sensitivity")),
    "Steps": (StepsView, "terminal", ("",)),
}
WHOLE_VERDICT = "Overview"
VERDICT = "Overview", "Compare", "Calibrate", "Diagnose", "Machine", "Report"  # views that show it
IN_PROGRESS = "Overview", "Calibrate", "Diagnose"  # views that show what a job has reported
START = """({
  dark: matchMedia('(prefers-color-scheme: dark)').matches,
  address: location.hash,
  listens: addEventListener('popstate', () => emitEvent('place', location.hash)),
})"""


class Page:
    """One window.

    Args:
        session: what all windows share.

    Attributes:
        dark: whether the page is dark.
        summary: the campaign in brief, see `CampaignCalculations.open`; None where it could not be read.
        readings: grows whenever `summary` or `problems` change.
        place: what was chosen to be looked at.
        shown: run and signal that are drawn.
    """

    def __init__(self, session: Session):
        self.session, self.workspace = session, session.workspace
        self.dark, self.summary = False, None
        self.floor: Any = None
        self._views: dict[str, Any] = {}
        self._places: dict[str, Any] = {}
        self._is_ready, self._changed = False, ()
        self._errors_shown: Any = None
        self._marks: tuple = ((), ())  # of the campaign and of the results that are shown
        self._built: set[str] = set()  # of the views, which begin to be built when they are first opened
        self.problems: list[str] = []
        self.readings = 0
        self.place, self.shown = Place(), ("", "")

    async def build(self) -> None:
        """Build the page; what needs a calculation follows when the browser is connected."""
        ui.colors(primary=PRIMARY)
        self.floor = ui.element("div")  # of dialogs, which outlive what was clicked
        ui.add_css(CSS)
        ui.add_body_html(watch_script(self.workspace.shown))
        mode = ui.dark_mode()
        with ui.header(elevated=False).classes("wb-header"), ui.row().classes("w-full items-center no-wrap wb-title"):
            ui.icon("monitor_heart").classes("text-xl")
            self._title = ui.label(self.workspace.folder.name).classes("text-base font-semibold ellipsis")
            self._errors = ui.row().classes("items-center wb-errors").props("data-mark=errors")
            ui.space()
            self._busy = ui.label("").classes("wb-busy ellipsis").props("data-mark=busy")
            self._cancel = ui.button("Cancel", on_click=self._cancel_running).props("flat dense no-caps color=white")
            turn = ui.button(icon="dark_mode", on_click=lambda: self._turn(mode))
            turn.props("flat round dense color=white aria-label='Light or dark page'")
            keys = ui.button(icon="keyboard", on_click=lambda: show_keys(self)).classes("gt-xs")
            keys.props("flat round dense color=white aria-label=Keys")
        with ui.tabs(on_change=lambda event: self._open(event.value)).classes("wb-tabs w-full") as self._tabs:
            for name, (_, icon, _) in VIEWS.items():
                ui.tab(name, icon=icon).props("no-caps")
        self._notice = ui.column().classes("wb-notice w-full").props("data-mark=changed role=status")
        self._notice.set_visibility(False)
        self._verdict = Verdict(lambda: self.go(view=WHOLE_VERDICT))
        with ui.tab_panels(self._tabs, animated=False, keep_alive=False).classes("w-full wb-panels"):
            for name in VIEWS:
                with ui.tab_panel(name):
                    self._places[name] = ui.column().classes("w-full gap-2")
        with ui.footer().classes("wb-footer"), ui.row().classes("w-full items-center no-wrap gap-2"):
            ui.icon("terminal")
            self._command = ui.label("").classes("wb-code ellipsis").props("data-mark=command")
            ui.space()
            copy = ui.button(icon="content_copy", on_click=lambda: ui.clipboard.write(self._command.text))
            copy.props("flat dense round size=sm aria-label='Copy the command'")
        await ui.context.client.connected(timeout=PATIENCE)
        self._client = ui.context.client
        ui.on("place", lambda event: self._arrive(event.args))
        ui.keyboard(self._press, ignore=["input", "select", "textarea"])
        found = await ui.run_javascript(START, timeout=PATIENCE)
        self.dark = found["dark"]
        mode.set_value(self.dark)
        marks = self._read_marks()
        await self.read_campaign()
        self._marks = marks
        self._is_ready = True
        if self._tabs.value in VIEWS:  # one was clicked meanwhile
            await self._open(self._tabs.value)
        else:
            await self._arrive(found["address"] or self.workspace.packed_place())
        self.show_state()
        ui.timer(POLL, self._look)

    async def read_campaign(self) -> None:
        """Read the campaign anew; what is wrong with it stands in `problems`. Until then, the earlier one is shown."""
        summary, problems = None, []
        if self.workspace.has_campaign:
            try:
                summary = await self.session.calculator.call("campaign.open", say=self.say)
                self._title.set_text(summary["name"])
            except CalculationError as error:
                problems = str(error).splitlines()
            self.say("")
        self.summary, self.problems = summary, problems
        self.readings += 1

    async def ask(self, name: str, *arguments: Any) -> Any:
        """The answer of the calculating process; None where there is none, which the user was told.

        Args:
            name: of the question, such as "campaign.compare".
            arguments: plain data.
        """
        try:
            return await self.session.calculator.call(name, *arguments, say=self.say)
        except CalculationCancelled:
            self.note("Cancelled; nothing was changed.")
        except CalculationError as error:
            self.tell(str(error))
        finally:
            self.say("")
        return None

    @property
    def missing(self) -> list[str]:
        """Why there is no campaign to look at; empty where there is one."""
        if self.summary is not None:
            return []
        return self.problems or ["There is no campaign in this folder yet. Begin in the view “Data”."]

    def has_campaign(self) -> bool:
        """Whether there is a campaign to work on; the user is told if not."""
        if self.missing:
            self.tell("\n".join(self.missing))
        return not self.missing

    def attempt(self, action: Callable[[], Any]) -> Any:
        """The result of an action on the folder; None where it was refused, which the user was told."""
        try:
            return action()
        except (WorkspaceError, OSError) as error:
            self.tell(str(error))
        return None

    def tell(self, text: str) -> None:
        """Show what is wrong, every problem in a line of its own, until it is closed."""
        lines = text.splitlines() or ["unknown"]
        with dialog(self, "This does not work yet", is_wide=True) as told:
            bullets(lines[:MAX_LISTED_PROBLEMS])
            if len(lines) > MAX_LISTED_PROBLEMS:
                ui.label(f"and {len(lines) - MAX_LISTED_PROBLEMS} more")
            Button("Close", on_click=told.close)

    def note(self, text: str) -> None:
        """Show a sentence for a few seconds."""
        with self.floor:
            ui.notify(text)

    def did(self, what: str, command: str, python: str) -> None:
        """Note what was done, with the command and the Python line that do the same."""
        self.attempt(lambda: self.workspace.add_step(what, command, python))
        self._show_command()

    def say(self, sentence: str) -> None:
        """Show what is being calculated."""
        self._busy.set_text(sentence)
        self._cancel.set_visibility(bool(sentence) or self.session.jobs.running() is not None)

    def move(self, **chosen: str) -> None:
        """Note what is looked at, see `Place`, in the address of the page; Back of the browser goes back there."""
        place = dataclasses.replace(self.place, **chosen)
        if place != self.place:
            self.place = place
            self._client.run_javascript(f"history.pushState(null, '', {json.dumps(place.address)})")

    async def go(self, **chosen: str) -> None:
        """Go to another place, see `Place`, and bring its view to the front."""
        self.move(**chosen)
        await self._show_place()

    def standing(self) -> Standing:
        """Where the model stands: what every view shows of errors, verdict and parts that miss something."""
        return standing(self.workspace, self.session.jobs)

    def show_state(self) -> None:
        """Show what stands above every view: the errors so far, the job that runs, the last command."""
        now = self.standing()
        errors = now.stages, now.corrected, now.use
        if errors != self._errors_shown:
            self._errors_shown = errors
            self._show_errors(now)
        if now.changed != self._changed:
            self._changed = now.changed
            self._notice.clear()
            with self._notice:
                for sentence in now.changed:
                    ui.label(sentence)
            self._notice.set_visibility(bool(now.changed))
        self._show_verdict(now)
        self._show_command()
        job = self.session.jobs.running()
        if job is not None and not self.session.calculator.busy_with:
            rows = self.session.jobs.progress(job)
            self.say(f"{job.title}: {rows[-1]['what'] if rows else 'starting'}")
        elif not self.session.calculator.busy_with:
            self.say("")

    def _show_errors(self, now: Standing) -> None:
        """Show the residual over noise after each stage."""
        self._errors.clear()
        with self._errors:
            for k, (name, row) in enumerate(now.stages.items()):
                value = row.get(now.use)
                if value is not None:
                    mark = "error-before" if k == 0 else "error-" + name.strip("+ ")
                    of = f", {BENCH_CORRECTED}" if name in now.corrected else ""
                    shown = ui.html(f"{'→ ' if k else ''}{html.escape(name)} <b>{value:.2f}</b>", sanitize=False)
                    shown.props["data-mark"] = mark
                    shown.tooltip(f"residual over noise on the {USES[now.use]}{of}; 1 is the noise of the sensors")
            if now.corrected:
                ui.label(f"({BENCH_CORRECTED})").classes("gt-sm")

    def _show_verdict(self, now: Standing) -> None:
        view = self._tabs.value
        self._verdict.show(now, view == WHOLE_VERDICT, self.summary is not None and view in VERDICT)

    def _show_command(self) -> None:
        """Show the last command that made what the view in front shows."""
        begins = VIEWS[self._tabs.value][2] if self._tabs.value in VIEWS else ()
        steps = [step for step in self.workspace.steps() if step.what.startswith(begins)] if begins else []
        self._command.set_text(steps[-1].command if steps else "")

    def _cancel_running(self) -> None:
        if self.session.calculator.busy_with:
            self.session.calculator.cancel()
        elif (job := self.session.jobs.running()) is not None:
            self.session.jobs.cancel(job)
            self.note(f"“{job.title}” is being interrupted; what is finished is kept.")

    async def _turn(self, mode) -> None:
        """Turn the page from light to dark, or back."""
        self.dark = not self.dark
        mode.set_value(self.dark)
        for name in self._built:
            await self._views[name].refresh()

    async def _arrive(self, address: str) -> None:
        """Go where an address says; a campaign opens with the overview."""
        self.place = Place.read(address)
        if self.place.view not in VIEWS:  # a packed place may be of anybody
            first = "Overview" if self.workspace.has_campaign else "Design" if self.workspace.config else "Data"
            self.place = dataclasses.replace(self.place, view=first)
        await self._show_place()

    async def _show_place(self) -> None:
        if self._tabs.value != self.place.view:
            self._tabs.set_value(self.place.view)  # which opens it
        elif self.place.view in self._built:
            await self._views[self.place.view].refresh()

    async def _press(self, event) -> None:
        """Do what a key stands for."""
        modifiers, key = event.modifiers, event.key.name
        if not event.action.keydown or modifiers.ctrl or modifiers.alt or modifiers.meta:
            return
        runs, signals = (list(self.summary[name]) if self.summary else [] for name in ("runs", "signals"))
        if key.isdecimal() and 1 <= int(key) <= len(VIEWS):
            await self.go(view=list(VIEWS)[int(key) - 1])
        elif key == HELP:
            show_keys(self)
        elif key in (NEXT_RUN, PREVIOUS_RUN) and runs:
            await self.go(run=neighbour(runs, self.shown[0], 1 if key == NEXT_RUN else -1))
        elif key in (NEXT_SIGNAL, PREVIOUS_SIGNAL) and signals:
            await self.go(signal=neighbour(signals, self.shown[1], 1 if key == NEXT_SIGNAL else -1))

    async def _open(self, name: str) -> None:
        if not self._is_ready:
            return
        self.move(view=name)
        self._show_verdict(self.standing())
        self._show_command()
        if name in self._built:
            await self._views[name].refresh()
        elif name in VIEWS and name not in self._views:
            self._views[name] = VIEWS[name][0](self)
            with self._places[name]:
                await self._views[name].build()
            self._built.add(name)

    async def _look(self) -> None:
        """Follow what other windows, jobs and commands do to the folder."""
        self.show_state()
        if any(job.status == RUNNING for job in self.session.jobs.all()):
            for name in self._built.intersection(IN_PROGRESS):
                await self._views[name].show_progress()
        marks = self._read_marks()
        if marks == self._marks or self.session.calculator.busy_with:
            return
        if marks[0] != self._marks[0]:
            await self.read_campaign()
        failed = None
        for name in tuple(self._built):
            try:
                await self._views[name].refresh()
            except Exception as error:  # of a half-written file: the other views follow, and it is tried again
                failed = error
        if failed is not None:
            raise failed
        self._marks = marks

    def _read_marks(self) -> tuple[tuple, tuple]:
        return self.workspace.campaign_mark(), self.workspace.results_mark()
