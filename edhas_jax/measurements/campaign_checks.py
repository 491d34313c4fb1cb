"""Is a campaign sound? Everything that looks wrong in its files, each with file, line and one sentence."""

from collections import Counter
from collections.abc import Callable

import numpy as np

from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.delay_checks import DelayCheck
from edhas_jax.measurements.signal_checks import check_quality, check_sensor
from edhas_jax.measurements.time_axis_checks import check_time_axis
from edhas_jax.measurements.unit_checks import check_units
from edhas_jax.simulation.run import Simulation, SimulationError, simulate

STEP = 50e-6  # s; a check asks for orders of magnitude and shapes
RATE = 2000.0  # Hz
LONGEST = 100.0  # s; a longer run is not compared with the model


def check_campaign(campaign: Campaign, on_progress: Callable[[float], None] | None = None) -> tuple[Remark, ...]:
    """What the reader and the checks noticed, in the order of the files.

    Every run whose time can be trusted is simulated with the engineer's model, roughly, for what only a comparison
    shows: unit slips and signals shifted against each other. `on_progress` is called with the share done, 0 … 1.
    """
    found = [*campaign.remarks]
    models: dict[str, dict[str, np.ndarray]] = {}
    for at, run in enumerate(campaign.runs):
        machine = campaign.machine_of(run)
        clock = list(check_time_axis(run, machine))
        found += clock
        if any("unit of time" in remark.sentence for remark in clock) or run.time[-1] > LONGEST:
            continue
        try:
            models[run.name] = _modelled(campaign, run, _part(on_progress, at, len(campaign.runs)))
        except SimulationError as error:
            what = f"not compared with the model, which cannot be run under these conditions: {error}"
            found.append(Remark(Severity.NOTE, run.file, 0, what))
    found += _sampling(campaign)
    for run in campaign.runs:
        for name in run.signals:
            said = [*check_sensor(campaign, run, name), *check_units(campaign, run, name, models)]
            # a stuck sensor or a slip of units spoils the noise and the shape too: one cause is told once
            found += said or check_quality(campaign, run, name)
    found += DelayCheck(campaign, models).check()
    order = {run.file: at for at, run in enumerate(campaign.runs)}
    return tuple(sorted(dict.fromkeys(found), key=lambda r: (order.get(r.file, -1), r.line)))


def _part(on_progress: Callable[[float], None] | None, at: int, of: int) -> Callable[[float], None]:
    return lambda share: on_progress((at + share) / of) if on_progress else None


def _modelled(campaign: Campaign, run: BenchRun, on_progress: Callable[[float], None]) -> dict[str, np.ndarray]:
    """The model's signals at the samples of a run, from rest at time 0."""
    settings = Simulation(duration=float(run.time[-1]) + 1.0 / RATE, step=STEP, sample_rate=RATE)
    signals = simulate(campaign.machine_of(run), settings, on_progress).signals
    return {name: np.interp(run.time, signals["time"], signals[name]) for name in run.signals}


def _sampling(campaign: Campaign) -> list[Remark]:
    """Notes on runs that are sampled otherwise than most, and warnings on files that are named twice."""
    rates = {run.name: round(1.0 / run.interval, 3) for run in campaign.runs}
    usual, _ = Counter(rates.values()).most_common(1)[0]
    notes = [
        Remark(Severity.NOTE, run.file, 0, f"is sampled at {rates[run.name]:.6g} Hz, most runs at {usual:.6g} Hz")
        for run in campaign.runs
        if abs(rates[run.name] / usual - 1.0) > 0.01
    ]
    files = Counter(run.file for run in campaign.runs)
    return notes + [
        Remark(Severity.WARNING, file, 0, f"serves {count} runs") for file, count in files.items() if count > 1
    ]
