"""Calibrate: choose parameters, runs, signals and time windows, watch the fit, see how certain it is."""

from nicegui import ui

from edhas_jax.core.units import exact_quantity
from edhas_jax.workbench.views.certainty import Certainty
from edhas_jax.workbench.views.elements import Block, Button, MainButton
from edhas_jax.workbench.views.fit_progress import FitProgress
from edhas_jax.workbench.views.job_panel import JobPanel
from edhas_jax.workbench.views.parameters import Parameters
from edhas_jax.workbench.views.runs_and_signals import RunsAndSignals
from edhas_jax.workbench.workspace import CALIBRATED

STOPPED = "This calibration was stopped: its values are the best until then, without further checks."
WITH_CHOICES = "This calibration was made with choices: its errors are those of the chosen signals and time windows."
CHANGED = "Something else was chosen after this calibration: calibrate again."


class CalibrateView:
    """Choices, job, progress, certainty."""

    def __init__(self, page):
        self._page = page
        self._checked: tuple = ()  # choices and campaign that were checked last

    async def build(self) -> None:
        """Build the view."""
        with ui.row().classes("items-center gap-3"):
            MainButton("Calibrate", on_click=self._calibrate, icon="straighten")
            self._from_fit = Button("Begin from the estimates", on_click=self._take_estimates, icon="redo")
            Button("As in the campaign", on_click=self._forget, icon="restart_alt")
            self._name = ui.input("keep this fit as").props("dense outlined").classes("min-w-40")
            self._keep = Button("Keep", on_click=self._keep_fit, icon="bookmark_add")
        self._problems = ui.column().classes("gap-0").props("data-mark=choices-problems role=status")
        self._state = ui.label("").props("data-mark=fit-state")
        self._job = JobPanel(self._page, {"calibrate": self._calibrate}, stops=True)
        self._progress = FitProgress(self._page, self._chosen)
        self._parameters = Parameters(self._page, self._chosen)
        self._runs = RunsAndSignals(self._page, self._chosen)
        with ui.expansion("the same in a terminal and in Python").classes("w-full wb-quiet").props("dense"):
            self._command = Block("").props("data-mark=fit-command")
            self._python = Block("").props("data-mark=fit-python")
            self._file = Block("").props("data-mark=fit-choices")
        self._certainty = Certainty(self._page, lambda: self._progress.cell)
        await self.refresh()

    async def refresh(self) -> None:
        """Follow the folder."""
        self._parameters.refresh()
        self._runs.refresh()
        self._show_state()
        if (of := (self._page.session.choices.text(), self._page.readings)) != self._checked:
            self._checked = of
            await self._check()
        await self.show_progress()
        await self._progress.refresh()
        await self._certainty.refresh()

    async def show_progress(self) -> None:
        """Show what the job that runs has reported."""
        self._job.refresh()
        await self._progress.follow()

    def _show_state(self) -> None:
        """Say what the last calibration is, and show what does the same as the button."""
        session, fit = self._page.session, self._page.workspace.result(CALIBRATED)
        said = [STOPPED] if fit is not None and fit.get("stopped") else []
        said += [WITH_CHOICES] if fit is not None and fit.get("choices") else []
        said += [CHANGED] if session.choices.changed_after_fit() else []
        self._state.set_text(" ".join(said))
        for element in (self._from_fit, self._keep, self._name):
            element.set_visibility(fit is not None)
        self._command.set_text(session.command_fit())
        self._python.set_text(session.python_fit())
        text = session.choices.text()
        self._file.set_text(f"# {session.choices.name}\n{text}" if text else "nothing is chosen: as in campaign.yaml")

    async def _chosen(self) -> None:
        """After something was chosen: say what is wrong with it."""
        self._show_state()
        self._parameters.refresh()
        self._runs.refresh()
        await self._check()
        await self._progress.follow()
        await self._certainty.refresh()

    async def _check(self) -> bool:
        """Whether the choices are right; what is wrong is shown."""
        if self._page.summary is None:
            return False
        found = await self._page.ask("fit.check", self._page.session.choices.read())
        self._problems.clear()
        if found is None:
            return False
        self._parameters.show_limits(found["limits"])
        with self._problems:
            for line in found["problems"]:
                ui.label(line).classes("wb-chip wb-bad")
        return not found["problems"]

    async def _calibrate(self) -> None:
        page = self._page
        if not page.has_campaign():
            return
        if not await self._check():
            page.note("The choices are not right yet.")
            return
        page.attempt(page.session.calibrate)
        page.show_state()
        await self.show_progress()

    async def _take_estimates(self) -> None:
        """Let the next search begin where the last one has ended."""
        choices = self._page.session.choices
        for name, row in (self._page.workspace.result(CALIBRATED) or {}).get("calibrated", {}).items():
            if "limit" not in row:
                value = exact_quantity(row["value"], row["unit"])
                choices.set_parameter(name, choices.parameter(name) | {"value": value})
        await self._chosen()

    async def _forget(self) -> None:
        self._page.session.choices.write({})
        await self._chosen()

    async def _keep_fit(self) -> None:
        if self._page.attempt(lambda: self._page.session.keep_fit(self._name.value or "") or True):
            self._page.note(f"Kept; the view “Compare” has it as “fit {self._name.value.strip()}”.")
            self._name.set_value("")
