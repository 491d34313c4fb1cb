"""Simulate a model as the runs of a campaign were made, and compare it with the measurements."""

import dataclasses
from collections.abc import Callable

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.machine.parameters import get_parameter, has_parameter
from edhas_jax.machine.rigs import Rig, Sine
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.replay import EXCLUDED_SIGNALS, Replay, machine_with_replay
from edhas_jax.measurements.residuals import normalised_residuals, rms_over_noise
from edhas_jax.measurements.time_resolution import MAX_ERROR_OVER_NOISE, TimeResolution, choose_time_resolution
from edhas_jax.simulation.integrator import signal_names
from edhas_jax.simulation.validity import signal_problems


@dataclasses.dataclass(frozen=True)
class RunComparison:
    """The model compared with the measurements of one run.

    Args:
        run: the run.
        model: signals of the model (samples,) by name at the measured time stamps, SI.
        residuals: normalised residuals (measured − model)/noise (samples,) by signal.
        frequency: frequency of a sine set point [Hz], NaN for any other set point.
        ramp_time: time at which the ramp of that sine is over [s].
    """

    run: BenchRun
    model: dict[str, np.ndarray]
    residuals: dict[str, np.ndarray]
    frequency: float
    ramp_time: float

    @property
    def phase(self) -> np.ndarray:
        """Position of each sample within its cycle (samples,), 0 … 1."""
        return (self.run.time * self.frequency) % 1.0

    @property
    def rms_over_noise(self) -> dict[str, float]:
        """Rms of the normalised residuals by signal."""
        return {name: rms_over_noise([values]) for name, values in self.residuals.items()}


@dataclasses.dataclass(frozen=True)
class Comparison:
    """A model compared with the measurements of a campaign.

    Args:
        campaign: the campaign.
        machine: the model.
        replay: the input that drove the model.
        resolution: time steps per sample, and their error.
        runs: the comparison of each run that could be simulated.
        remarks: which runs were left out, and why.
    """

    campaign: Campaign
    machine: Rig
    replay: Replay
    resolution: TimeResolution
    runs: tuple[RunComparison, ...]
    remarks: tuple[Remark, ...]

    def rms_over_noise(self) -> dict[str, dict[str, float]]:
        """Rms of the normalised residuals by run and signal."""
        return {compared.run.name: compared.rms_over_noise for compared in self.runs}

    @property
    def signals(self) -> tuple[str, ...]:
        """The signals that have residuals in some run."""
        return tuple(n for n in self.campaign.channels if any(n in compared.residuals for compared in self.runs))


def compare(
    campaign: Campaign, machine: Rig | None = None, instruments: Instruments = Instruments(),
    replay: Replay = Replay.SET_POINT, on_progress: Callable[[str], None] | None = None,
) -> Comparison:  # fmt: skip
    """Simulate a model as the bench was run, with a time step whose error is far below the noise.

    Args:
        campaign: the measurements; they are checked first, see `checked_campaign`.
        machine: the model; the campaign's machine by default.
        instruments: measurement chains that record the signals of the model.
        replay: the input that drives the model.
        on_progress: called with a sentence before each stage of the work.

    Returns:
        The signals of the model and the residuals of each run; runs that cannot be driven by this input are left out.

    Raises:
        CampaignError: no run can be driven by this input.
        ParameterError: the machine lacks a parameter that the runs set.
    """
    report_progress = on_progress or (lambda sentence: None)
    report_progress("checking the data")
    campaign = checked_campaign(campaign)
    machine = campaign.machine if machine is None else machine
    runs, remarks = [], []
    for run in campaign.runs:
        try:
            machine_with_replay(campaign, run, machine, replay)
            runs.append(run)
        except CampaignError as error:
            problem = str(error).removeprefix(f"{run.file}: ")
            remarks.append(run.remark(Severity.ERROR, f"{problem}; the run is left out"))
    if not runs:
        raise CampaignError("\n".join(map(str, remarks)))
    available = signal_names(machine)
    others = (n for n in machine.explaining or machine.signals if n in available and n != "time")
    signals = tuple(dict.fromkeys([*campaign.channels, *others]))
    model = MeasurementModel(campaign, machine, (), runs, instruments, signals, replay)
    report_progress("choosing the time step")
    resolution = choose_time_resolution(model, np.zeros(0))
    report_progress("simulating the runs")
    predicted = model.predict_all_runs(np.zeros(0), resolution.fine)
    compared = []
    for r, run in enumerate(runs):
        residuals = normalised_residuals(campaign, run, predicted[r])
        residuals = {n: v for n, v in residuals.items() if n not in EXCLUDED_SIGNALS[replay]}
        simulated = machine_with_replay(campaign, run, machine, replay)
        for status, reason in signal_problems(simulated, predicted[r].values):
            severity = Severity.NOTE if status.is_valid else Severity.WARNING
            sentence = f"in the model's run {reason}" if status.is_valid else f"the model's run is not valid: {reason}"
            remarks.append(run.remark(severity, sentence))
        frequency, ramp_time = _sine_set_point(campaign.machine_of(run, machine))
        compared.append(RunComparison(run, predicted[r].values, residuals, frequency, ramp_time))
    if resolution.error > MAX_ERROR_OVER_NOISE:
        step = 1e6 * model.longest_interval() / resolution.fine
        sentence = f"their error is still {resolution.error:.2g} of the noise; residuals of this size say nothing"
        tried = f"the model's runs are not valid: with the smallest step tried, {step:.3g} µs"
        remarks.append(campaign.runs[0].warning(f"{tried}, {sentence}"))
    return Comparison(campaign, machine, replay, resolution, tuple(compared), tuple(remarks))


def _sine_set_point(machine: Rig) -> tuple[float, float]:
    """Frequency [Hz] and ramp time [s] of a sine set point; NaN and 0 for any other."""
    if isinstance(getattr(machine, "reference", None), Sine) and has_parameter(machine, "reference.frequency"):
        return float(get_parameter(machine, "reference.frequency")), float(machine.reference.ramp_time)
    return float("nan"), 0.0
