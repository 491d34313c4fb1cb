"""Check the data of a campaign: everything that looks wrong in its files, with file, line and one sentence."""

from collections import Counter
from collections.abc import Callable

import numpy as np

from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.delay_checks import DelayCheck
from edhas_jax.measurements.signal_checks import check_quality, check_sensor
from edhas_jax.measurements.time_axis_checks import check_time_axis
from edhas_jax.measurements.unit_checks import check_units
from edhas_jax.simulation.run import Simulation, SimulationError, simulate

SIMULATION_STEP = 50e-6  # s; the checks need orders of magnitude and shapes only
SIMULATION_SAMPLE_RATE = 2000.0  # Hz
MAX_SIMULATED_LENGTH = 100.0  # s; a longer run is not compared with the model


def check_campaign(campaign: Campaign, on_progress: Callable[[float], None] | None = None) -> tuple[Remark, ...]:
    """Check the files of a campaign.

    Every run with a usable time axis is simulated with the campaign's machine at low accuracy, because wrong units and
    time shifts between signals show only in the comparison with a model.

    Args:
        campaign: the campaign.
        on_progress: called with the completed share of the simulations, 0 … 1.

    Returns:
        The remarks of the reader and of the checks, in the order of the files and lines.
    """
    remarks = [*campaign.remarks]
    models: dict[str, dict[str, np.ndarray]] = {}
    for k, run in enumerate(campaign.runs):
        machine = campaign.machine_of(run)
        time_remarks = list(check_time_axis(run, machine))
        remarks += time_remarks
        wrong_unit = any("unit of time" in remark.sentence for remark in time_remarks)
        if wrong_unit or run.time[-1] > MAX_SIMULATED_LENGTH:
            continue
        try:
            models[run.name] = _simulated(campaign, run, _share_of_all(on_progress, k, len(campaign.runs)))
        except SimulationError as error:
            sentence = f"not compared with the model, which cannot be simulated under these conditions: {error}"
            remarks.append(Remark(Severity.NOTE, run.file, 0, sentence))
    remarks += _check_sampling_and_files(campaign)
    for run in campaign.runs:
        for name in run.signals:
            causes = [*check_sensor(campaign, run, name), *check_units(campaign, run, name, models)]
            # a stuck sensor or a wrong unit also disturbs noise and shape: the cause is reported, not its effects
            remarks += causes or check_quality(campaign, run, name)
    remarks += DelayCheck(campaign, models).check()
    order = {run.file: k for k, run in enumerate(campaign.runs)}
    return tuple(sorted(dict.fromkeys(remarks), key=lambda r: (order.get(r.file, -1), r.line)))


def _share_of_all(on_progress: Callable[[float], None] | None, k: int, count: int) -> Callable[[float], None]:
    """A callback for the completed share of task `k` of `count` that reports the share of all tasks."""
    return lambda share: on_progress((k + share) / count) if on_progress else None


def _simulated(campaign: Campaign, run: BenchRun, on_progress: Callable[[float], None]) -> dict[str, np.ndarray]:
    """The signals of the model (samples,) at the time stamps of a run, SI."""
    duration = float(run.time[-1]) + 1.0 / SIMULATION_SAMPLE_RATE
    settings = Simulation(duration=duration, step=SIMULATION_STEP, sample_rate=SIMULATION_SAMPLE_RATE)
    signals = simulate(campaign.machine_of(run), settings, on_progress).signals
    return {name: np.interp(run.time, signals["time"], signals[name]) for name in run.signals}


def _check_sampling_and_files(campaign: Campaign) -> list[Remark]:
    """Notes on runs with another sampling rate than most, and warnings on files that several runs name."""
    rates = {run.name: round(1.0 / run.interval, 3) for run in campaign.runs}
    common, _ = Counter(rates.values()).most_common(1)[0]
    notes = [
        Remark(Severity.NOTE, run.file, 0, f"is sampled at {rates[run.name]:.6g} Hz, most runs at {common:.6g} Hz")
        for run in campaign.runs
        if abs(rates[run.name] / common - 1.0) > 0.01
    ]
    files = Counter(run.file for run in campaign.runs)
    return notes + [
        Remark(Severity.WARNING, file, 0, f"is used by {count} runs") for file, count in files.items() if count > 1
    ]
