"""A model beside the measurements of a campaign, run by run."""

import dataclasses
from collections.abc import Callable

import jax
import numpy as np

from edhas_jax.campaign import BenchRun, Campaign, CampaignError, Remark, Severity
from edhas_jax.instruments import Instruments
from edhas_jax.integrate import observe
from edhas_jax.misfit import level, whitened
from edhas_jax.parameters import get_parameter
from edhas_jax.prediction import Case, Model
from edhas_jax.replay import GIVEN, Replay, has_parameter, mount
from edhas_jax.resolution import SHARE, Resolution, choose_resolution
from edhas_jax.system import Rig, Sine

# what a residual is looked at against, beside what was measured
SEEN = (
    "reference", "voltage", "current", "piston_position", "piston_velocity", "chamber_pressure_a", "outlet_pressure",
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class RunView:
    """One run: the model's signals (n,) at the measured instants, SI, and (measured − model)/noise by signal.

    `frequency` [Hz] is that of a sine that drives it, NaN for any other drive; `steady` [s] is when its ramp is over.
    """

    run: BenchRun
    model: dict[str, np.ndarray]
    residuals: dict[str, np.ndarray]
    frequency: float
    steady: float

    @property
    def phase(self) -> np.ndarray:
        """Where in the cycle each sample lies, 0 … 1."""
        return (self.run.time * self.frequency) % 1.0

    @property
    def levels(self) -> dict[str, float]:
        """Residual over noise by signal."""
        return {name: level([values]) for name, values in self.residuals.items()}


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A machine beside a campaign; `views` by run. `remarks` say which runs were left out and why."""

    campaign: Campaign
    machine: Rig
    replay: Replay
    resolution: Resolution
    views: tuple[RunView, ...]
    remarks: tuple[Remark, ...]

    def matrix(self) -> dict[str, dict[str, float]]:
        """Residual over noise by run and signal."""
        return {view.run.name: view.levels for view in self.views}

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals that are judged."""
        return tuple(n for n in self.campaign.channels if any(n in view.residuals for view in self.views))


def compare(
    campaign: Campaign,
    machine: Rig | None = None,
    instruments: Instruments = Instruments(),
    replay: Replay = Replay.SET_POINT,
    on_progress: Callable[[str], None] | None = None,
) -> Comparison:
    """Run a machine (default: the campaign's) as the bench was run, at a step whose error is far below the noise.

    Raises:
        CampaignError: no run can be driven so.
        ParameterError: the machine lacks what the campaign's runs set.
    """
    say = on_progress or (lambda sentence: None)
    machine = campaign.machine if machine is None else machine
    runs, remarks = [], []
    for run in campaign.runs:
        try:
            mount(campaign, run, machine, replay)
            runs.append(run)
        except CampaignError as error:
            what = str(error).removeprefix(f"{run.file}: ")
            remarks.append(Remark(Severity.ERROR, run.file, 0, f"{what}; the run is left out"))
    if not runs:
        raise CampaignError("\n".join(map(str, remarks)))
    here = jax.eval_shape(lambda m: observe(m, m.start(), 0.0, 1.0), machine)
    watch = tuple(dict.fromkeys([*campaign.channels, *(n for n in SEEN if n in here)]))
    model = Model(campaign, machine, (), runs, instruments, watch, replay)
    say("looking for the step that serves")
    resolution = choose_resolution(model, np.zeros(0), SHARE)
    say("simulating the runs")
    outcomes = model.outcomes([Case(np.zeros(0), tuple(range(len(runs))))], resolution.fine, derive=False)[0]
    views = []
    for r, run in enumerate(runs):
        residuals = whitened(campaign, run, outcomes[r])
        residuals = {n: v for n, v in residuals.items() if n not in GIVEN[replay]}
        views.append(RunView(run, outcomes[r].values, residuals, *_drive(campaign.machine_of(run, machine))))
    return Comparison(campaign, machine, replay, resolution, tuple(views), tuple(remarks))


def _drive(machine: Rig) -> tuple[float, float]:
    if isinstance(machine.reference, Sine) and has_parameter(machine, "reference.frequency"):
        return float(get_parameter(machine, "reference.frequency")), float(machine.reference.ramp_time)
    return float("nan"), 0.0
