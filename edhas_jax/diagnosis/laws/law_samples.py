"""Values along the fitted runs of what a law at a slot depends on, and of what an effect contributes there."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.runtime import code_hash
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects.tabulated_law import LawPlace, rig_of, tabulated_class
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rig_base import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import placeholder_parameter
from edhas_jax.simulation.batch_trajectories import Observe, simulate_batch

LAW = "law"
SOURCE = ("diagnosis/laws/law_samples.py",)


@dataclasses.dataclass(frozen=True)
class LawSamples:
    """Samples along the fitted runs at the places of one slot, all places of a valve or chamber together.

    Args:
        values: values (m,) of each signal that a law at the slot may depend on, SI.
        law: contribution (m,) of an effect to the slot, SI; None without an effect.
    """

    values: dict[str, np.ndarray]
    law: np.ndarray | None

    def weight(self, place: LawPlace) -> np.ndarray:
        """The product (m,) of the factors of a place; ones for a place without any."""
        out = np.ones_like(self.values[place.variable])
        for name in place.factors:
            out = out * self.values[name]
        return out


class _Probe(NamedTuple):
    """What is known at the places of some slots: signals by slot, and the contribution of an effect to the first."""

    names: tuple[tuple[str, str], ...]
    effect: str | None

    def __call__(self, machine, y, t, h) -> dict[str, Any]:
        """The values at one instant, named `slot:signal.place`."""
        probes = tuple(_probe(rig_of(machine), slot, name) for slot, name in self.names)
        s, _ = structs.replace(machine, effects=(*machine.effects, *probes)).evaluate(y, t, h, y)
        made = s.record.contributions
        rows = {pair: made[pair[0]][probe.id] for pair, probe in zip(self.names, probes, strict=True)}
        if self.effect is not None:
            first = self.names[0][0]
            rows[first, LAW] = made[first][self.effect]
        return {f"{slot}:{name}.{place}": v for (slot, name), row in rows.items() for place, v in enumerate(row)}

    def key(self) -> str:
        """A text for what is observed, with the source of this module."""
        return f"{self} {code_hash(SOURCE)}"


def _probe(rig, slot: str, name: str):
    """An effect whose contribution to a slot is a signal."""
    place = LawPlace(slot, "time", (name,), rig)
    return tabulated_class(f"probe_{name}_at_{slot}", place, 2)(node_1=0.0, node_2=1.0, value_1=1.0, value_2=1.0)


def law_samples(fit: Fit, places: Sequence[LawPlace], effect: str | None = None) -> LawSamples:
    """Simulate the fitted runs and record what happens at a slot.

    Args:
        fit: the fit.
        places: places at one slot, whose variables and factors are wanted.
        effect: id of an effect at the slot whose contribution is wanted too.

    Returns:
        The samples of all runs, one after another.
    """
    return samples_at_slots(fit, places, effect)[places[0].slot]


def samples_at_slots(fit: Fit, places: Sequence[LawPlace], effect: str | None = None) -> dict[str, LawSamples]:
    """The same for places at several slots, recorded together, by slot; the effect is one at the slot of the first."""
    if not places:  # a rig of one's own without slots
        return {}
    names = tuple(dict.fromkeys((place.slot, name) for place in places for name in (place.variable, *place.factors)))
    observer = _Probe(names, effect)
    by_run = [along_runs(fit.campaign, fit.machine, [run], fit.resolution.coarse, observer) for run in fit.runs]
    columns: dict[str, list[np.ndarray]] = {}
    for key, values in (item for found in by_run for item in found.items()):
        columns.setdefault(key.rpartition(".")[0], []).append(values)
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    found: dict[str, dict[str, np.ndarray]] = {}
    for slot, name in names:
        found.setdefault(slot, {})[name] = joined[f"{slot}:{name}"]
    return {slot: LawSamples(values, joined.get(f"{slot}:{LAW}")) for slot, values in found.items()}


def along_runs(
    campaign: Campaign, machine: Rig, runs: Sequence[BenchRun], steps_per_sample: int, observer: Observe
) -> dict[str, np.ndarray]:
    """Simulate runs, and observe what happens at their samples.

    Args:
        campaign: gives the conditions of the runs.
        machine: the machine, before these conditions are set.
        runs: the runs.
        steps_per_sample: time steps from sample to sample.
        observer: see `simulate_batch`.

    Returns:
        What was observed, by name, the samples of one run after those of another.
    """
    columns: dict[str, list[np.ndarray]] = {}
    for run in runs:
        there = campaign.machine_of(run, machine)
        samples = math.ceil(run.time[-1] / run.interval - 1e-4) + 1
        name = placeholder_parameter(there)
        values = {name: np.array([float(get_parameter(there, name))])}
        step = run.interval / steps_per_sample
        traces = simulate_batch(there, values, None, step, steps_per_sample, samples, observer).values
        for key, column in traces.items():
            columns.setdefault(key, []).append(column[:, 0])
    return {name: np.concatenate(parts) for name, parts in columns.items()}
