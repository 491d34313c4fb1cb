"""Validity of results: the status of a run or of a design, the same tests for both."""

import enum
from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.core import runtime
from edhas_jax.core.units import format_quantity
from edhas_jax.machine.components.mover import EndStops
from edhas_jax.machine.interface import slots
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, PumpBench, Rig

STEP_SENSITIVITY = 0.01  # relative change of flow, power or stroke with the step, above which they are not trusted
BALANCE_TOLERANCE = 0.02  # share by which a result may miss a bound of physics
EFFICIENCY_TOLERANCE = 5e-4  # of an efficiency above 1: with one decimal, 100.0 % is shown at most
SMALLEST_POWER = 1e-9  # W, below which a balance of powers says nothing
BEYOND_RANGE = "_beyond_range"  # among the metrics: > 0 where a limited signal left its valid range


class Status(enum.IntEnum):
    """The outcome of a run or of a design."""

    OK = 0
    NOT_PERIODIC = 1
    STALLED = 2
    HIT_STOPS = 3
    OUT_OF_RANGE = 4
    NOT_FINITE = 5
    STEP_TOO_LARGE = 6
    IMPLAUSIBLE = 7
    RELIEF_OPEN = 8
    FEW_SAMPLES = 9

    def __str__(self) -> str:
        return self.name.lower()

    @property
    def is_valid(self) -> bool:
        """Whether the numbers are those of the model; if not, the run or the settings have to be changed."""
        return self in VALID


# these numbers are right: they describe a machine that does not do what it should, or that has not settled yet
VALID = frozenset((Status.OK, Status.NOT_PERIODIC, Status.STALLED, Status.HIT_STOPS))

REASONS = {
    Status.OK: "periodic, within the model's validity",
    Status.NOT_PERIODIC: "still changing from cycle to cycle at the end",
    Status.STALLED: "the piston follows less than half of its set point",
    Status.HIT_STOPS: "the piston ran onto an end stop",
    Status.OUT_OF_RANGE: "a valve, a pressure, the gas or the piston left the range that the model describes",
    Status.NOT_FINITE: "the run is not finite",
    Status.STEP_TOO_LARGE: "flow, power or stroke depend on the step: take a smaller one",
    Status.IMPLAUSIBLE: "the volumetric efficiency lies outside 0 … 100 %, or more power goes out than comes in",
    Status.RELIEF_OPEN: "the accumulator pressure is above the relief pressure: the relief valve never closes, and the "
    "model lets it pump oil",
    Status.FEW_SAMPLES: "too few samples per cycle for peaks, rms values and phase: raise `sample_rate`",
}


def valid_ranges(machine: Rig) -> dict[str, tuple]:
    """The limits (low, high) in SI of the signals that are physical only within a range, by name."""
    y = machine.initial_state()
    return machine.evaluate(y, 0.0, 1.0, y)[0].record.valid_ranges


def departure(machine: Rig, name: str, values: np.ndarray) -> tuple[str, str]:
    """How a signal left the range in which it is physical, as the end of a sentence, and what this means.

    Args:
        machine: the machine.
        name: the signal.
        values: its last samples, SI; those beyond the range may be NaN.
    """
    with runtime.double_precision():
        low, high = (float(limit) for limit in valid_ranges(machine)[name])
    about, last = machine.signals[name], values[np.isfinite(values)][-1:]
    if about.unit == "Pa" and low == 0.0 and (last < 0.5 * high).all():
        lacks_air = slots.OIL_GAS in machine.slots and not slots.is_used(slots.OIL_GAS, machine.effects)
        remedy = "; mount the effect entrained_air" if lacks_air else ""
        return "falls to zero", f"oil cavitates there, which this model does not describe{remedy}"
    limits = f"{format_quantity(low, about.unit)} … {format_quantity(high, about.unit)}"
    return "left its physical range", f"the range is {limits}"


def failed_tests(m: Rig, values: Mapping[str, Any], periodic, xp=jnp) -> list[tuple[Status, Any]]:
    """Each status with whether it applies, in increasing severity; for numbers as for arrays of designs.

    Args:
        m: the machine, a rig of the package.
        values: metrics in SI by name, with `BEYOND_RANGE` if the ranges are to be tested here; a test without its
            metrics is left out.
        periodic: whether the cycles have converged.
        xp: `jax.numpy`, or `numpy` for the numbers of one run, of which nothing is then compiled.
    """
    half = 0.5 * m.stops.pump_stroke
    tests = [(Status.NOT_PERIODIC, ~xp.asarray(periodic))]
    if "amplitude_ratio" in values:
        tests.append((Status.STALLED, values["amplitude_ratio"] < 0.5))
    if "peak_stroke" in values:
        tests.append((Status.HIT_STOPS, values["peak_stroke"] > half))
    # a system also gives back what its load has stored, so only benches have these bounds
    if "mean_electrical_power" in values and not isinstance(m, ActuatorSystem):
        tests.append((Status.IMPLAUSIBLE, _breaks_a_bound(m, values)))
    if not isinstance(m, ActuatorBench):
        always_open = m.accumulator.accumulator_pressure > m.outlet.relief_pressure
        tests.append((Status.RELIEF_OPEN, always_open & (m.outlet.relief_conductance > 0.0)))
    if BEYOND_RANGE in values:
        tests.append((Status.OUT_OF_RANGE, values[BEYOND_RANGE] > 0.0))
    finite = [xp.isfinite(v) for n, v in values.items() if n != "residual"]
    return [*tests, (Status.NOT_FINITE, ~xp.stack(finite).all())]


def _breaks_a_bound(m: Rig, values: Mapping[str, Any]):
    """Whether copper and load take more than the supply gives, or the pump's volumetric efficiency is not 0 … 1.

    Where a line has inertia the oil flows on through open valves, and more is delivered than swept.
    """
    supplied, delivered = values["mean_electrical_power"], values.get("delivered_power", 0.0)
    excess = values["copper_loss"] + delivered - supplied
    broken = excess > BALANCE_TOLERANCE * abs(supplied) + SMALLEST_POWER
    broken = broken | (delivered > (1.0 + EFFICIENCY_TOLERANCE) * supplied + SMALLEST_POWER)
    if "volumetric_efficiency" in values:
        efficiency = values["volumetric_efficiency"]
        broken = broken | (efficiency < -BALANCE_TOLERANCE)
        if not any(slots.is_used(slot, m.effects) for slot in (slots.SUCTION_LINE_FLOW, slots.OUTLET_LINE_FLOW)):
            broken = broken | (efficiency > 1.0 + EFFICIENCY_TOLERANCE)
    return broken


def status_of(m: Rig, values: Mapping[str, Any], periodic):
    """The most severe status that applies, as an integer of `Status`; see `failed_tests`."""
    status = jnp.asarray(Status.OK, int)
    for candidate, applies in failed_tests(m, values, periodic):
        status = jnp.where(applies, candidate, status)
    return status


def signal_problems(machine: Rig, signals: Mapping[str, np.ndarray]) -> list[tuple[Status, str]]:
    """What is wrong with a simulated run of which only some signals are there, most severe first; empty if nothing is.

    Args:
        machine: the machine of the run.
        signals: SI arrays (samples,) by name.
    """
    found = []
    if not all(np.isfinite(values).all() for values in signals.values()):
        return [(Status.NOT_FINITE, REASONS[Status.NOT_FINITE])]
    with runtime.double_precision():
        ranges = {n: (float(low), float(high)) for n, (low, high) in valid_ranges(machine).items() if n in signals}
    for name, (low, high) in ranges.items():
        if signals[name].min() < low or signals[name].max() > high:
            found.append((Status.OUT_OF_RANGE, f"{name.replace('_', ' ')} leaves the range that the model describes"))
    if isinstance(machine, PumpBench | ActuatorSystem):
        outlet, pressure = machine.outlet, machine.accumulator.accumulator_pressure
        if float(pressure) > float(outlet.relief_pressure) and float(outlet.relief_conductance) > 0.0:
            found.append((Status.RELIEF_OPEN, REASONS[Status.RELIEF_OPEN]))
    stops, position = getattr(machine, "stops", None), signals.get("piston_position")
    if isinstance(stops, EndStops) and position is not None and np.abs(position).max() > 0.5 * float(stops.pump_stroke):
        found.append((Status.HIT_STOPS, REASONS[Status.HIT_STOPS]))
    return found
