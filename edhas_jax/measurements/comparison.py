"""A model beside the measurements of a campaign, run by run."""


import dataclasses
from collections.abc import Callable

import jax
import numpy as np
import pandas as pd

from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import Rig, Sine
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Remark, Severity
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.predicted_signals import Case, Model, level, whitened
from edhas_jax.measurements.replay import GIVEN, Replay, has_parameter, mount
from edhas_jax.measurements.step_selection import SHARE, Resolution, choose_resolution
from edhas_jax.simulation.integrator import observe

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



COLUMNS = {
    "residual_over_noise": "rms of (measured − model), in standard deviations of the sensor's noise",
    "nrmse": "the same over the range of what was measured",
    "peak": "largest value: measured − model",
    "mean": "mean value: measured − model",
    "amplitude": "first harmonic: measured over model",
    "phase": "first harmonic: measured after model, rad",
    "delay": "measured after model, s, from the slope of the residual along the model's rate",
    "memory": "correlation of residuals one sample apart: 0 for noise",
    "white": "whether the residuals pass for white noise (portmanteau test over 20 samples, 1 %)",
}
LAGS, CRITICAL = 20, 37.57  # χ² with 20 degrees of freedom, 1 %


def figures_of_merit(comparison: Comparison) -> pd.DataFrame:
    """A table indexed by run and signal with the columns of `COLUMNS`, SI."""
    rows = {
        (view.run.name, signal): _row(view, signal) for view in comparison.views for signal in view.residuals
    }  # fmt: skip
    index = pd.MultiIndex.from_tuples(rows, names=["run", "signal"])
    return pd.DataFrame(list(rows.values()), index=index, columns=list(COLUMNS))


def _row(view: RunView, signal: str) -> dict[str, float]:
    measured, model, white = view.run.signals[signal], view.model[signal], view.residuals[signal]
    ok = np.isfinite(measured) & np.isfinite(model)
    if ok.sum() < 2:
        return dict.fromkeys(COLUMNS, np.nan) | {"residual_over_noise": np.inf, "white": False}
    off = np.where(ok, measured - model, np.nan)
    rate = np.gradient(model, view.run.time)[ok]
    slow = float(rate @ rate)
    memory, portmanteau = whiteness(white)
    harmonic = _harmonics(view, measured, model, ok)
    return {
        "residual_over_noise": level([white]),
        "nrmse": float(np.sqrt(np.nanmean(off**2)) / (np.ptp(measured[ok]) or np.nan)),
        "peak": float(measured[ok].max() - model[ok].max()),
        "mean": float(np.nanmean(off)),
        "amplitude": abs(harmonic),
        "phase": float(-np.angle(harmonic)) if np.isfinite(harmonic) else np.nan,
        "delay": -float(off[ok] @ rate) / slow if slow > 0.0 else np.nan,
        "memory": memory,
        "white": bool(portmanteau < CRITICAL),
    }


def _harmonics(view: RunView, measured: np.ndarray, model: np.ndarray, ok: np.ndarray) -> complex:
    """The first harmonic of what was measured over that of the model, over whole cycles after the ramp."""
    if not np.isfinite(view.frequency):
        return complex(np.nan)
    time = view.run.time
    cycles = np.floor((time[-1] - view.steady) * view.frequency)
    inside = ok & (time > time[-1] - cycles / view.frequency)
    if cycles < 1 or not inside.any():
        return complex(np.nan)
    turn = np.exp(-2j * np.pi * view.frequency * time[inside])
    below = np.mean((model[inside] - model[inside].mean()) * turn)
    above = np.mean((measured[inside] - measured[inside].mean()) * turn)
    return complex(above / below) if abs(below) > 0.0 else complex(np.nan)


def whiteness(residuals: np.ndarray) -> tuple[float, float]:
    """Correlation one sample apart, and Ljung and Box's statistic over `LAGS` samples; holes are taken as 0.

    Source: Ljung, Box, Biometrika 65 (1978) 297.
    """
    values = np.nan_to_num(residuals - np.nanmean(residuals))
    n, power = len(values), float(values @ values)
    if power == 0.0 or n <= LAGS:
        return 0.0, 0.0
    memory = np.array([float(values[lag:] @ values[:-lag]) / power for lag in range(1, LAGS + 1)])
    return float(memory[0]), float(n * (n + 2) * np.sum(memory**2 / (n - np.arange(1, LAGS + 1))))
