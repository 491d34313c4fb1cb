"""What all windows of one workbench share: the folder, the calculating process, the jobs, the code that may run."""

import json
import shlex

from edhas_jax.workbench.calculator import Calculator
from edhas_jax.workbench.choices import Choices
from edhas_jax.workbench.jobs import Job, JobList
from edhas_jax.workbench.workspace import CALIBRATED, DIAGNOSED, RESULTS, TRIED, Decisions, Workspace


class Session:
    """One workbench that is open.

    Args:
        workspace: its folder.

    Attributes:
        calculator: answers the questions of all windows.
        jobs: the long commands.
        choices: what is chosen for the next calibration.
    """

    def __init__(self, workspace: Workspace):
        self.workspace = workspace
        self.calculator = Calculator(workspace.folder, workspace.allowed)
        self.jobs = JobList(workspace)
        self.choices = Choices(workspace)

    def calibrate(self) -> Job:
        """Start `edhas fit` with the choices of the folder."""
        self._out(CALIBRATED)
        return self._start("calibrate", self._fit_arguments(), self.python_fit())

    def command_fit(self, *more: str) -> str:
        """The command that calibrates with the choices of the folder."""
        return shlex.join(["edhas", *self._fit_arguments(), *more])

    def python_fit(self, profile: str = "") -> str:
        """The Python line that does the same, perhaps with the profile of a parameter."""
        shown = self.workspace.shown
        chosen = f', profiles=["{profile}"]' if profile else ""
        chosen += f', choices="{shown / self.choices.name}"' if self.choices.exist else ""
        return f'edhas.fit("{shown}"{chosen}).save("{shown / RESULTS / CALIBRATED}")'

    def keep_fit(self, name: str) -> None:
        """Keep the present calibration under a name."""
        folder = self.workspace.keep_fit(name)
        shown, made = self.workspace.shown, self.workspace.shown / RESULTS / CALIBRATED
        command = shlex.join(["cp", "-r", str(made), str(shown / folder)])
        python = f'shutil.copytree("{made}", "{shown / folder}")'
        self.workspace.add_step(f"keep the fit {folder.name}", command, python)

    def _fit_arguments(self) -> list[str]:
        shown = self.workspace.shown
        arguments = ["fit", str(shown), "--out", str(shown / RESULTS / CALIBRATED), "--overwrite"]
        return arguments + (["--choices", str(shown / self.choices.name)] if self.choices.exist else [])

    def diagnose(self) -> Job:
        """Start `edhas diagnose`; the same command goes on from finished fits."""
        out = self._out(DIAGNOSED)
        arguments = ["diagnose", str(self.workspace.shown), "--out", out, "--overwrite"]
        allowed = self.workspace.allowed
        for spec in allowed:
            arguments += ["--effect", spec]
        effects = f", {allowed}" if allowed else ""
        return self._start("diagnose", arguments, f'edhas.diagnose("{self.workspace.shown}"{effects}).save("{out}")')

    def report_comparison(self, model: str) -> Job:
        """Start `edhas compare`, which writes the report of a comparison."""
        arguments = [*self._compare_arguments(model), "--out", self._out("compared"), "--overwrite"]
        return self._start("report the comparison", arguments, self.python_compare(model))

    def run_design_task(self, command: str, file: str, out: str) -> Job:
        """Start `edhas sweep`, `edhas size` or `edhas sensitivity` on a file below the folder."""
        shown = self.workspace.shown
        arguments = [command, str(shown / file), "--out", str(shown / out)]
        arguments += [] if command == "sweep" else ["--overwrite"]
        keep = f', folder="{shown / out}")' if command == "sweep" else f').save("{shown / out}")'
        return self._start(command, arguments, f'edhas.{command}("{shown / file}"{keep}')

    def command_compare(self, model: str, replay: str = "set_point") -> str:
        """The command that compares a model with the measurements."""
        replays = [] if replay == "set_point" else ["--replay", replay]
        return shlex.join(["edhas", *self._compare_arguments(model), *replays])

    def python_compare(self, model: str) -> str:
        """The Python line that does the same."""
        words = ", ".join(f'"{word}"' for word in self._compare_arguments(model)[1:] if word != "--model")
        return f"comparison = edhas.compare({words})"

    def _compare_arguments(self, model: str) -> list[str]:
        path, shown = self.workspace.models().get(model), self.workspace.shown
        file = [] if path is None else ["--model", str(shown / path.relative_to(self.workspace.folder))]
        return ["compare", str(shown), *file]

    def command_try(self, names: list[str]) -> str:
        """The command that fits the model with effects; files are those of the folder."""
        out = self.workspace.shown / RESULTS / TRIED / '+'.join(n.rpartition(':')[2] for n in names)
        return shlex.join(["edhas", "add", str(self.workspace.shown), *self._from_here(names), "--out", str(out)])

    def python_try(self, names: list[str]) -> str:
        """The Python lines that do the same."""
        return f'added = edhas.add("{self.workspace.shown}", {json.dumps(self._from_here(names))})'

    def _from_here(self, names: list[str]) -> list[str]:
        """The names of effects as a command of the working folder has them."""
        return [str(self.workspace.shown / name) if ":" in name else name for name in names]

    def decide(self, name: str, is_added: bool = False, reason: str | None = None) -> None:
        """Add a suspect to the model, or reject it for a reason; otherwise it is neither in the model nor rejected."""
        old = self.workspace.decisions()
        added = [n for n in old.added if n != name] + [name] * is_added
        rejected = {n: why for n, why in old.rejected.items() if n != name}
        self.workspace.decide(Decisions(tuple(added), rejected if reason is None else rejected | {name: reason}))

    def allow(self, spec: str) -> None:
        """Let an effect of a file run until the workbench ends.

        Raises:
            WorkspaceError: the file lies outside the folder.
        """
        source, _, name = spec.rpartition(":")
        file = self.workspace.inside(source).relative_to(self.workspace.folder)
        spec = f"{self.workspace.shown / file}:{name}"
        if spec not in self.workspace.allowed:
            self.workspace.allowed.append(spec)

    def _start(self, title: str, arguments: list[str], python: str) -> Job:
        if title in ("calibrate", "diagnose"):
            self.workspace.require_files_inside()
        job = self.jobs.start(title, arguments)
        self.workspace.add_step(title, job.command, python)
        return job

    def _out(self, name: str) -> str:
        self.workspace.inside(f"{RESULTS}/{name}").parent.mkdir(exist_ok=True)
        return str(self.workspace.shown / RESULTS / name)
