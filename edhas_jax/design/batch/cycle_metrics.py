"""Metrics of one cycle of a design, added up in the time loop."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.one_sided_minmax import one_sided_max
from edhas_jax.core import structs
from edhas_jax.machine.components.set_points import CyclicSine
from edhas_jax.machine.interface.metrics import all_taken, instant, metrics_of_batch, signals_read, values_of
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.integrator import step_with_outputs
from edhas_jax.simulation.validity import BEYOND_RANGE, valid_ranges


def cycle_step(m: Rig, y, sums, n, steps, first) -> tuple[dict[str, Any], dict[str, Any]]:
    """One time step of a cycle, with its contribution to the totals from which metrics are computed.

    Args:
        m: the machine, driven by a sine.
        y: its state.
        sums: totals of the cycle so far, see `empty_sums`.
        n: number of the step in the cycle, from 0.
        steps: steps per cycle.
        first: true in the first cycle, where a ramp brings the set point in.

    Returns:
        The new state, and the new totals.
    """
    phase = (n + 0.5) / steps
    h = 1.0 / (m.reference.frequency * steps)
    taken = all_taken(metrics_of_batch(m))
    driven = structs.replace(m, reference=CyclicSine.at_phase(m.reference, phase, first))
    y, seen, beyond = _observed_step(driven, y, h, signals_read(m, taken.values()))
    s = instant(seen, phase)
    new = {key: one.add(sums[key], one.of(m, s)) for key, one in taken.items()}
    return y, new | {BEYOND_RANGE: one_sided_max(beyond, sums[BEYOND_RANGE])}


PERIODIC = ("mean_flow", "mean_electrical_power", "peak_stroke")  # their change tells whether a design is periodic


def cycle_change(new: dict[str, Any], old: dict[str, Any]):
    """The largest relative change from one cycle to the next among the metrics `PERIODIC`."""
    pairs = [(new[n], old[n]) for n in PERIODIC if n in new]
    return jnp.max(jnp.stack([jnp.abs(a - b) / (jnp.abs(a) + jnp.finfo(a.dtype).tiny) for a, b in pairs]), axis=0)


def _observed_step(m: Rig, y, h, wanted):
    """The new state, the signals `wanted` at mid-step, and how far a limited signal is beyond its range."""
    ranges = valid_ranges(m)
    names = dict.fromkeys([*wanted, *(n for n in ranges if n not in y)])
    y, _, seen = step_with_outputs(m, y, 0.0, h, lambda s: {n: getattr(s, n) for n in names})
    beyond = None
    for name, (low, high) in ranges.items():
        value = y.get(name, seen.get(name))
        for excess in (low - value, value - high):
            beyond = excess if beyond is None else one_sided_max(excess, beyond)
    return y, seen, beyond


def empty_sums(m: Rig, dtype) -> dict[str, Any]:
    """The totals at the start of a cycle."""
    starts = {key: one.start for key, one in all_taken(metrics_of_batch(m)).items()} | {BEYOND_RANGE: -np.inf}
    return {key: np.full((), start, dtype) for key, start in starts.items()}


def cycle_metrics(m: Rig, sums, share) -> dict[str, Any]:
    """The metrics of a cycle from its totals.

    Args:
        m: the machine.
        sums: what `cycle_step` has added up.
        share: 1/steps of the cycle.
    """
    metrics = metrics_of_batch(m)
    found = {one: one.end(sums[key], share) for key, one in all_taken(metrics).items()}
    return values_of(metrics, m, found) | {BEYOND_RANGE: sums[BEYOND_RANGE]}
