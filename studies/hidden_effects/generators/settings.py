"""What a sheet of parameters and the settings of a bench are off by, which the campaign does not say."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from edhas_jax.machine.parameters import get_parameter, list_parameters, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign

MAX_DEVIATION = 2.0  # standard deviations at which parameters are clipped where the sheet is right


@dataclasses.dataclass(frozen=True)
class RunDrift:
    """A deviation from run to run.

    Args:
        id: its name.
        parameter: what it changes; None for the settings of the bench, each by itself.
        factors: (rng, runs) → factor of the parameter in each run (runs,).
    """

    id: str
    parameter: str | None
    factors: Callable[[np.random.Generator, int], np.ndarray]


@dataclasses.dataclass(frozen=True)
class WrongSheet:
    """A sheet of parameters that is worse than it states: (rng, count) → deviations in standard deviations (count,)."""

    id: str
    deviations: Callable[[np.random.Generator, int], np.ndarray]


def usual_deviations(rng: np.random.Generator, count: int) -> np.ndarray:
    """Deviations of a sheet that is right, in standard deviations."""
    return np.clip(rng.standard_normal(count), -MAX_DEVIATION, MAX_DEVIATION)


def with_deviations(plan: Campaign, machine: Rig, deviations: np.ndarray) -> Rig:
    """The machine with its uncertain parameters at known · exp(σ · deviation), in the order that their laws demand."""
    spreads = {name: spread.size for name, spread in plan.uncertain_in(machine).items()}
    values = {
        name: float(get_parameter(machine, name)) * float(np.exp(spread * deviation))
        for (name, spread), deviation in zip(spreads.items(), deviations, strict=True)
    }
    for p, _, _ in list_parameters(machine):
        if p.at_least and p.name in values:
            limit = values.get(p.at_least)
            limit = float(get_parameter(machine, p.at_least)) if limit is None else limit
            values[p.name] = max(values[p.name], limit)
    return set_parameters(machine, values)


def draw_drifts(
    drifts: Sequence[RunDrift], settings: Sequence[str], runs: int, rng: np.random.Generator
) -> tuple[tuple[str, ...], Mapping[str, np.ndarray]]:
    """Draw one or two kinds of drift.

    Args:
        drifts: the kinds that there are.
        settings: parameters that are set by hand in each run.
        runs: number of runs.
        rng: the random generator.

    Returns:
        Names with the largest deviation, and the factors of each parameter by run.
    """
    usable = [d for d in drifts if d.parameter is not None or settings]
    names, factors = [], {}
    for k in rng.permutation(len(usable))[: rng.integers(1, 3)]:
        drift = usable[k]
        for parameter in settings if drift.parameter is None else (drift.parameter,):
            found = drift.factors(rng, runs)
            factors[parameter] = factors.get(parameter, 1.0) * found
            names.append(f"{drift.id}: {parameter} up to {100.0 * np.abs(found - 1.0).max():.2g} %")
    return tuple(names), factors
