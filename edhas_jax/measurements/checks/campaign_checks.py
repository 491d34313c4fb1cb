"""Check the data of a campaign: say what looks wrong, leave out what is impossible, measure the noise."""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, SignalsByRun
from edhas_jax.measurements.checks.copied_records import check_copies
from edhas_jax.measurements.checks.delay_checks import DelayCheck
from edhas_jax.measurements.checks.impossible_samples import (
    find_impossible_samples,
    find_signal_outliers,
    removal_of,
)
from edhas_jax.measurements.checks.noise_measurement import noise_remarks, with_measured_noise
from edhas_jax.measurements.checks.signal_checks import check_quality, noise_ratios
from edhas_jax.measurements.checks.start_checks import check_start
from edhas_jax.measurements.checks.time_axis_checks import check_time_axis
from edhas_jax.measurements.checks.unit_checks import check_units
from edhas_jax.measurements.checks.wiring_checks import check_saturation, check_wiring
from edhas_jax.measurements.clock_alignment import with_aligned_clocks
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.simulation.run import Simulation, SimulationError, simulate

MAX_SIMULATED_LENGTH = 100.0  # s; a longer run of a rig with a fast `check_interval` is not compared with the model
UNKNOWN_NOISE = (
    "its noise is not stated, and no record is long and even enough to measure it; state `noise:`, the standard "
    "deviation in the unit of the signal"
)


def checked_campaign(campaign: Campaign, on_progress: Callable[[float], None] | None = None) -> Campaign:
    """Check the data of a campaign, leave out what is impossible, and measure the noise.

    Every run with a usable time axis is simulated with the campaign's machine at low accuracy, because wrong units,
    reversed signals and time shifts show only in the comparison with a model. `compare`, `fit`, `diagnose` and
    `plan_detectability` call this function themselves; a campaign that is checked already is returned as it is.

    Args:
        campaign: the campaign.
        on_progress: called with the completed share of the simulations, 0 … 1.

    Returns:
        The campaign without impossible signals and samples (NaN), with the noise as `with_measured_noise` says, and
        with the remarks of the reader and of the checks in the order of the files and lines.

    Raises:
        CampaignError: no run has a signal that can be used.
    """
    if campaign.is_checked:
        return campaign
    measured = [run for run in campaign.runs if run.signals]
    remarks = [*campaign.remarks]
    models = _simulated_runs(campaign, measured, remarks, on_progress)
    remarks += [*_check_sampling_and_files(measured), *check_copies(measured)]
    for run in measured:
        remarks += check_wiring(campaign, run, models)
    campaign, unusable = _without_unknown_noise(with_measured_noise(campaign))
    remarks += unusable
    if not campaign.channels:
        raise CampaignError("\n".join([*map(str, remarks), f"{campaign.folder}: no signal of any run can be used"]))
    runs = [run for run in campaign.runs if run.signals]
    remarks = [*noise_remarks(campaign), *remarks]
    outliers = {name: find_signal_outliers(campaign, name, models) for name in campaign.channels}
    ratios = {name: noise_ratios(campaign, name) for name in campaign.channels}
    usual = {n: float(np.median([r for r in of.values() if r > 0.0] or [0.0])) for n, of in ratios.items()}
    cleaned, removed = [], []
    for run in runs:
        signals = {}
        for name, values in run.signals.items():
            causes = check_units(campaign, run, name, models, ratios[name][run.name])
            wrong = outliers[name][run.name]
            impossible, found = find_impossible_samples(campaign, run, name, models, wrong, usual[name])
            signals[name] = np.where(impossible, np.nan, values) if impossible.any() else values
            removed += [removal_of(run, name, impossible)] if impossible.any() else []
            # a stuck sensor or a wrong unit also disturbs noise and shape: the cause is reported, not its effects
            remarks += [*causes, *found] or check_quality(campaign, run, name, ratios[name])
        cleaned.append(dataclasses.replace(run, signals=signals))
    channels = {name: _with_model_error(channel) for name, channel in campaign.channels.items()}
    campaign = dataclasses.replace(_with_runs(campaign, cleaned), channels=channels, removed=tuple(removed))
    if campaign.stated_accuracy.clocks:
        interval, step = _simulated_interval(campaign, runs)
        before = campaign.remarks
        fastest = {run.whole: run.interval for run in sorted(runs, key=lambda run: -run.interval)}
        campaign = with_aligned_clocks(campaign, max(1, math.ceil(max(fastest.values()) / step - 1e-9)))
        remarks += campaign.remarks[len(before):]
    for run in campaign.runs:
        remarks += check_start(campaign, run, models)
    for name in campaign.channels:
        remarks += check_saturation(campaign, name, models)
    remarks += DelayCheck(campaign, models).check()
    order = {run.file: k for k, run in enumerate(campaign.runs)}
    ordered = sorted(dict.fromkeys(remarks), key=lambda r: (order.get(r.file, -1), r.line))
    return dataclasses.replace(campaign, remarks=tuple(ordered), is_checked=True)


def _with_model_error(channel: Channel) -> Channel:
    """A channel whose noise contains what the model may leave beside it, which is taken as white."""
    if not channel.model_error:
        return channel
    return dataclasses.replace(channel, noise=math.hypot(channel.noise, channel.model_error), correlation=())


def _with_runs(campaign: Campaign, runs: list[BenchRun]) -> Campaign:
    """A campaign with these runs in place of its measured ones; runs that are only planned stay."""
    changed = {run.name: run for run in runs}
    kept = [changed.get(run.name, run) for run in campaign.runs if run.name in changed or not run.signals]
    return dataclasses.replace(campaign, runs=tuple(kept))


def _without_unknown_noise(campaign: Campaign) -> tuple[Campaign, list[Remark]]:
    """The campaign without the signals whose noise is neither stated nor measured, and a remark on each."""
    unknown = [name for name, channel in campaign.channels.items() if not math.isfinite(channel.noise)]
    sentence = f"{UNKNOWN_NOISE}; the signal is left out"
    channels = {name: channel for name, channel in campaign.channels.items() if name not in unknown}
    runs = tuple(run.without_signals(unknown) for run in campaign.runs) if unknown else campaign.runs
    remarks = [campaign.remark(Severity.ERROR, f"{name}: {sentence}") for name in unknown]
    return dataclasses.replace(campaign, channels=channels, runs=runs), remarks


def _simulated_runs(
    campaign: Campaign, runs: list[BenchRun], remarks: list[Remark], on_progress: Callable[[float], None] | None
) -> SignalsByRun:
    """The signals of the model by run and signal; adds remarks on time axes and on runs that cannot be simulated."""
    usable = []
    for run in runs:
        time_remarks = list(check_time_axis(run, campaign.machine_of(run)))
        remarks += time_remarks
        wrong_unit = any("unit of time" in remark.sentence for remark in time_remarks)
        if not wrong_unit and (not campaign.machine.check_interval or run.time[-1] <= MAX_SIMULATED_LENGTH):
            usable.append(run)
    models = _simulated_together(campaign, usable)
    for k, run in enumerate(usable):
        if run.name in models:
            continue

        def on_share(share: float, done: int = k) -> None:
            if on_progress is not None:
                on_progress((done + share) / len(usable))

        try:
            models[run.name] = _simulated(campaign, run, on_share)
        except SimulationError as error:
            sentence = f"not compared with the model, which cannot be simulated under these conditions: {error}"
            remarks.append(run.remark(Severity.NOTE, sentence))
    return models


def _simulated_together(campaign: Campaign, runs: list[BenchRun]) -> dict[str, dict[str, np.ndarray]]:
    """The signals of the model at the time stamps of the runs, SI, without the runs that fail at this step."""
    names = tuple(name for name in campaign.channels if any(name in run.signals for run in runs))
    if not names:
        return {}
    interval, step = _simulated_interval(campaign, runs)
    grids = [interval * np.arange(math.ceil(run.time[-1] / interval) + 1) for run in runs]
    evenly = [dataclasses.replace(run, time=grid) for run, grid in zip(runs, grids, strict=True)]
    model = MeasurementModel(campaign, campaign.machine, (), evenly, signals=names)
    predicted = model.predict_all_runs(np.zeros(0), math.ceil(interval / step - 1e-9))
    return {
        run.name: {name: np.interp(run.time, grids[r], predicted[r].values[name]) for name in run.signals}
        for r, run in enumerate(runs)
        if all(np.isfinite(values).all() for values in predicted[r].values.values())
    }


def _simulated_interval(campaign: Campaign, runs: list[BenchRun]) -> tuple[float, float]:
    """Sample interval and time step [s] of the simulations for the checks."""
    interval = campaign.machine.check_interval
    return (interval, 0.1 * interval) if interval else (min(run.interval for run in runs), campaign.machine.time_step)


def _simulated(campaign: Campaign, run: BenchRun, on_progress: Callable[[float], None]) -> dict[str, np.ndarray]:
    """The signals of the model (samples,) at the time stamps of a run, SI, with as small a step as it takes."""
    interval, step = _simulated_interval(campaign, [run])
    settings = Simulation(duration=float(run.time[-1]) + interval, step=step, sample_rate=1.0 / interval)
    signals = simulate(campaign.machine_of(run), settings, on_progress).signals
    return {name: np.interp(run.time, signals["time"], signals[name]) for name in run.signals}


def _check_sampling_and_files(runs: list[BenchRun]) -> list[Remark]:
    """Notes on runs with another sampling rate than most, and warnings on files that several runs name."""
    runs = list({run.whole: run for run in reversed(runs)}.values())[::-1]  # the first part of each
    rates, files = [round(1.0 / run.interval, 3) for run in runs], Counter(run.file for run in runs)
    common = Counter(rates).most_common(1)[0][0] if rates else 0.0
    others = [(run, rate) for run, rate in zip(runs, rates, strict=True) if abs(rate / common - 1.0) > 0.01]
    notes = [run.remark(Severity.NOTE, f"is sampled at {r:.6g} Hz, most runs at {common:.6g} Hz") for run, r in others]
    several = [(file, count) for file, count in files.items() if count > 1]
    return notes + [Remark(Severity.WARNING, file, 0, f"is used by {count} runs") for file, count in several]
