"""Candidate runs of a bench: a grid of conditions around those of a campaign, restricted to feasible ones."""

import itertools
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.parameters import find_parameter, get_parameter, has_parameter
from edhas_jax.machine.rigs import ActuatorSystem, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.measurement_model import MeasurementModel

CYCLES_PER_RUN = 4.0  # of a periodic set point, after its soft start
# number of grid values of a condition, and the factors by which they extend below and above those of the campaign
GRID_BY_CONDITION = {"frequency": (5, 1.5, 1.5), "amplitude": (2, 1.75, 1.0)}
DEFAULT_GRID = (3, 1.5, 1.5)
MIN_RANGE_RATIO = {"frequency": 5.25}  # a grid around a single frequency would be too narrow
BENCH_CONDITIONS = ("frequency", "amplitude", "load_orifice_area")
LIMIT_SHARE = 0.99  # share of a limit that a run may use
# largest magnitude of a signal: a parameter of the machine times a factor
SIGNAL_LIMITS = {"piston_position": ("pump_stroke", 0.5), "voltage": ("supply_voltage", 1.0),
                 "cylinder_position": ("cylinder_stroke", 1.0)}  # fmt: skip


def feasible_runs(campaign: Campaign, machine: Rig, per_sample: int) -> tuple[BenchRun, ...]:
    """The candidate runs in which a machine stays off its end stops and, on a bench, below its supply voltage.

    Args:
        campaign: its runs define the grid of conditions.
        machine: the machine that is simulated in every candidate run.
        per_sample: integration steps per sample.

    Returns:
        Runs without signals; empty where the set point is a recording.
    """
    candidates = candidate_runs(campaign)
    if not candidates:
        return ()
    limits = {
        signal: factor * LIMIT_SHARE * float(get_parameter(machine, parameter))
        for signal, (parameter, factor) in SIGNAL_LIMITS.items() if has_parameter(machine, parameter)
    }  # fmt: skip
    if isinstance(machine, ActuatorSystem):  # the pump of a system may saturate while it is far from the set point
        del limits["voltage"]
    if not limits:
        return tuple(candidates)
    model = MeasurementModel(campaign, machine, (), candidates, signals=tuple(limits))
    outcomes = model.predict_all_runs(np.zeros(0), per_sample)
    return tuple(
        run
        for r, run in enumerate(candidates)
        if all(np.abs(outcomes[r].values[signal]).max() <= limit for signal, limit in limits.items())
    )


def candidate_runs(campaign: Campaign) -> list[BenchRun]:
    """Every run of the grid of conditions, feasible or not.

    Frequency, amplitude, load orifice and every condition that the campaign sets are varied; all other conditions are
    those of its first run. Empty where the set point of a run is a recording.
    """
    machine, nominal = campaign.machine, campaign.runs[0]
    if any(run.recordings for run in campaign.runs):
        return []
    names = dict.fromkeys(n for run in campaign.runs for n in run.conditions)
    if periodic_duration(machine, {}):
        names |= dict.fromkeys(n for n in BENCH_CONDITIONS if has_parameter(machine, n))
    grid = {name: _grid_values(campaign, name) for name in names}
    interval, runs = min(run.interval for run in campaign.runs), []
    for values in itertools.product(*grid.values()):
        conditions = nominal.conditions | dict(zip(grid, values, strict=True))
        duration = periodic_duration(machine, conditions) or nominal.time[-1]
        time = interval * np.arange(round(duration / interval) + 1)
        name = ", ".join(format_conditions(campaign, conditions).values())
        runs.append(BenchRun(name, Path(name), Use.FIT, conditions, time, {}, np.arange(len(time)) + 2))
    return runs


def periodic_duration(machine: Rig, conditions: dict[str, float]) -> float | None:
    """The duration [s] of a run of a bench with a sinusoidal set point; None for any other machine."""
    if machine.cycle is None:
        return None
    frequency = conditions.get("frequency", float(machine.reference.frequency))
    return float(machine.reference.ramp_time) + CYCLES_PER_RUN / frequency


def _grid_values(campaign: Campaign, name: str) -> Sequence[float]:
    """Grid values (SI) of a condition, rounded to two digits; in equal ratios where all are positive."""
    nominal = float(get_parameter(campaign.machine, name))
    used = [run.conditions.get(name, nominal) for run in campaign.runs]
    count, below, above = GRID_BY_CONDITION.get(name, DEFAULT_GRID)
    low, high = min(used), max(used)
    if low > 0.0:
        above = max(above, MIN_RANGE_RATIO.get(name, 1.0) * low / (below * high))
        values = np.geomspace(low / below, high * above, count)
    elif low < high:
        values = np.linspace(low, high, count)
    else:
        return [low]
    span = find_parameter(campaign.machine, name)[0].span
    return list(dict.fromkeys(float(f"{v:.2g}") for v in values if span[0] <= v <= span[1]))


def format_conditions(campaign: Campaign, conditions: dict[str, float]) -> dict[str, str]:
    """Format conditions (SI) as text with units."""
    return {n: format_quantity(v, find_parameter(campaign.machine, n)[0].unit) for n, v in conditions.items()}
