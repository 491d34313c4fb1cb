"""One block of designs through all its cycles: sums and peaks in the time loop, metrics and a verdict at the end."""

import enum
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.core import structs
from edhas_jax.machine.components.set_points import CyclicSine
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import ActuatorBench, Rig
from edhas_jax.simulation.integrator import step_with_outputs


class Status(enum.IntEnum):
    """What became of a design; anything but OK says why its metrics are not to be trusted."""

    OK = 0
    NOT_PERIODIC = 1
    STALLED = 2
    HIT_STOPS = 3
    OUT_OF_RANGE = 4
    NOT_FINITE = 5
    STEP_TOO_LARGE = 6


REASONS = {
    Status.OK: "periodic, within the model's validity",
    Status.NOT_PERIODIC: "still changing from cycle to cycle when the cycles ran out",
    Status.STALLED: "the piston follows less than half of its set point",
    Status.HIT_STOPS: "the piston ran onto an end stop",
    Status.OUT_OF_RANGE: "a valve, a pressure or the piston left the range that the model describes",
    Status.NOT_FINITE: "the run is not finite",
    Status.STEP_TOO_LARGE: "slow to become periodic, and flow, power or stroke hang on the step: take a smaller one",
}


class Lanes(NamedTuple):
    """Where the designs of a block stand; every leaf has the shape (lanes,).

    `kept` are the metrics of the last cycle that counts, `cycles` its number; `done`: no further one is wanted.
    """

    y: dict[str, Any]
    kept: dict[str, Any]
    cycles: Any
    done: Any


def begin(machine: Rig, block: dict[str, Any], live, dtype) -> Lanes:
    """All designs at rest. `block` holds the parameters that vary, in SI; lanes that are not `live` only fill it up."""

    def at_rest(values):
        m = set_parameters(machine, values)
        y = {n: jnp.asarray(v, dtype) for n, v in m.initial_state().items()}
        one = jnp.ones((), dtype)
        return y, measured(m, empty_sums(m, dtype), one) | {CHANGE: one, "residual": one}

    y, kept = jax.vmap(at_rest)(block)
    return Lanes(y, kept, jnp.zeros_like(live, int), ~live)


def advance(machine: Rig, block: dict[str, Any], lanes: Lanes, number, until, steps, tolerance, soft) -> Lanes:
    """Cycles from `number` on until every design is periodic or `until` is reached; the first is a ramp if `soft`.

    A design that is periodic keeps the metrics of the cycle in which it was found to be.
    """
    dtype = jnp.result_type(tolerance)
    count = steps.astype(dtype)

    def cycle(values, y, number):
        m = set_parameters(machine, values)
        sums = empty_sums(m, dtype)
        y, sums = jax.lax.fori_loop(
            0, steps, lambda n, c: cycle_step(m, *c, n.astype(dtype), count, soft & (number == 0)), (y, sums)
        )
        return y, measured(m, sums, 1.0 / count)

    def going_on(carry):
        number, lanes = carry
        return (number < until) & ~lanes.done.all()

    def next_cycle(carry):
        number, lanes = carry
        y, new = jax.vmap(cycle, in_axes=(0, 0, None))(block, lanes.y, number)
        return number + 1, judged(lanes, y, new, number, tolerance)

    return jax.lax.while_loop(going_on, next_cycle, (number, lanes))[1]


def cycle_step(m: Rig, y, sums, n, steps, first) -> tuple[dict[str, Any], dict[str, Any]]:
    """Step n of the `steps` steps of a cycle: the new state, and the sums and peaks with what it adds to them.

    In the `first` cycle a ramp brings the set point in.
    """
    phase = (n + 0.5) / steps
    h = 1.0 / (m.reference.frequency * steps)
    y, seen = _take(structs.replace(m, reference=CyclicSine.at_phase(m.reference, phase, first)), y, h)
    return y, _add(m, sums, seen, phase)


def judged(lanes: Lanes, y, new: dict[str, Any], number, tolerance) -> Lanes:
    """The lanes after the cycle `number`, which left the states `y` and the metrics `new`.

    The residual is the larger of the last two changes: a single one may be small where a slow drift turns around.
    """
    _, kept, cycles, done = lanes
    change = changed(new, kept)
    residual = jnp.where(number < 2, jnp.ones_like(change), jnp.maximum(change, kept[CHANGE]))
    new = new | {CHANGE: change, "residual": residual}
    kept = {n: jnp.where(done, kept[n], new[n]) for n in kept}
    cycles = jnp.where(done, cycles, number + 1)
    finite = jnp.isfinite(kept["mean_electrical_power"])
    return Lanes(y, kept, cycles, done | (new["residual"] <= tolerance) | ~finite)


def verdict(machine: Rig, block: dict[str, Any], kept: dict[str, Any], done) -> dict[str, Any]:
    """The metrics, with the `status` of each design."""
    status = jax.vmap(lambda values, out, ok: _status(set_parameters(machine, values), out, ok))(block, kept, done)
    return {n: v for n, v in kept.items() if not n.startswith("_")} | {"status": status}


PERIODIC = ("mean_flow", "mean_electrical_power", "peak_stroke")
CHANGE = "_change"  # of these from one cycle to the next


def changed(new: dict[str, Any], old: dict[str, Any]):
    """The largest relative change of the metrics that tell whether a design is periodic."""
    there = [n for n in PERIODIC if n in new]
    return jnp.max(jnp.stack([_change(new[n], old[n]) for n in there]), axis=0)


def _change(new, old):
    return jnp.abs(new - old) / (jnp.abs(new) + jnp.finfo(new.dtype).tiny)


def _watched(m: Rig) -> tuple[str, ...]:
    actuator = ("voltage", "coil_voltage", "current", "resistance", "piston_position", "piston_velocity", "reference")
    if isinstance(m, ActuatorBench):
        return actuator
    return (*actuator, "outlet_flow", "outlet_pressure", "accumulator_pressure", "load_drop", "leakage_a", "leakage_b")


def _take(m: Rig, y, h):
    y, _, seen = step_with_outputs(m, y, 0.0, h, lambda s: {n: getattr(s, n) for n in _watched(m)})
    if not isinstance(m, ActuatorBench):
        lifts = [y[f"{kind}_lift_{side}"] for kind in ("suction", "delivery") for side in "ab"]
        seen["highest_lift"] = one_sided_max(one_sided_max(lifts[0], lifts[1]), one_sided_max(lifts[2], lifts[3]))
        seen["lowest_lift"] = one_sided_min(one_sided_min(lifts[0], lifts[1]), one_sided_min(lifts[2], lifts[3]))
    return y, seen


SUMS = ("power", "copper", "current²", "voltage²", "error²", "x sin", "x cos", "r sin", "r cos")
PUMP_SUMS = ("flow", "leakage", "swept", "delivered")
PEAKS = ("current", "voltage", "stroke")
PUMP_PEAKS = ("leakage", "pressure", "rise", "lift", "-pressure", "-lift")


def empty_sums(m: Rig, dtype) -> dict[str, Any]:
    """The sums and peaks at the start of a cycle."""
    pump = not isinstance(m, ActuatorBench)
    zeros = {n: jnp.zeros((), dtype) for n in SUMS + (PUMP_SUMS if pump else ())}
    return zeros | {f"peak {n}": jnp.full((), -jnp.inf, dtype) for n in PEAKS + (PUMP_PEAKS if pump else ())}


def _add(m: Rig, sums, s, phase) -> dict[str, Any]:
    """What one step adds to the sums and peaks of a cycle."""
    i, u, x = s["current"], s["voltage"], s["piston_position"]
    sine, cosine = jnp.sin(2 * jnp.pi * phase), jnp.cos(2 * jnp.pi * phase)
    supplied = u if "current" in m.amplifier.initial() else s["coil_voltage"]
    new = {
        "power": supplied * i, "copper": s["resistance"] * i * i, "current²": i * i, "voltage²": u * u,
        "error²": (s["reference"] - x) ** 2, "x sin": x * sine, "x cos": x * cosine,
        "r sin": s["reference"] * sine, "r cos": s["reference"] * cosine,
    }  # fmt: skip
    peaks = {"current": jnp.abs(i), "voltage": jnp.abs(u), "stroke": jnp.abs(x)}
    if "outlet_flow" in s:
        rise = s["outlet_pressure"] - s["accumulator_pressure"]
        new |= {
            "flow": s["outlet_flow"], "leakage": s["leakage_a"] + s["leakage_b"],
            "swept": jnp.abs(s["piston_velocity"]), "delivered": s["outlet_flow"] * s["load_drop"],
        }  # fmt: skip
        peaks |= {
            "leakage": one_sided_max(jnp.abs(s["leakage_a"]), jnp.abs(s["leakage_b"])), "rise": rise,
            "pressure": s["outlet_pressure"], "-pressure": -s["outlet_pressure"],
            "lift": s["highest_lift"], "-lift": -s["lowest_lift"],
        }  # fmt: skip
    return {n: sums[n] + v for n, v in new.items()} | {
        f"peak {n}": one_sided_max(v, sums[f"peak {n}"]) for n, v in peaks.items()
    }


def measured(m: Rig, sums, share) -> dict[str, Any]:
    """The metrics of a cycle from its sums, each step having the `share` 1/steps; named as in
    `edhas_jax.simulation.metrics`."""
    mean = {n: v * share for n, v in sums.items() if not n.startswith("peak ")}
    peak = {n.removeprefix("peak "): v for n, v in sums.items() if n.startswith("peak ")}
    got, wanted = (mean["x sin"], mean["x cos"]), (mean["r sin"], mean["r cos"])
    square = wanted[0] ** 2 + wanted[1] ** 2
    out = {
        "mean_electrical_power": mean["power"], "copper_loss": mean["copper"],
        "rms_current": jnp.sqrt(mean["current²"]), "peak_current": peak["current"],
        "rms_voltage": jnp.sqrt(mean["voltage²"]), "peak_voltage": peak["voltage"],
        "peak_stroke": peak["stroke"], "tracking_error": jnp.sqrt(mean["error²"]),
        "amplitude_ratio": jnp.sqrt((got[0] ** 2 + got[1] ** 2) / square),
        "phase_lag": jnp.arctan2(
            got[0] * wanted[1] - got[1] * wanted[0], got[0] * wanted[0] + got[1] * wanted[1]
        ),
    }  # fmt: skip
    if "flow" in mean:
        out |= {
            "mean_flow": mean["flow"], "mean_leakage": mean["leakage"], "peak_leakage": peak["leakage"],
            "peak_outlet_pressure": peak["pressure"], "pressure_rise": peak["rise"],
            "pressure_ripple": peak["pressure"] + peak["-pressure"],
            "volumetric_efficiency": mean["flow"] / (m.pump.area() * mean["swept"]),
            "delivered_power": mean["delivered"], "overall_efficiency": mean["delivered"] / mean["power"],
            "_lift": peak["lift"], "_-lift": peak["-lift"], "_-pressure": peak["-pressure"],
        }  # fmt: skip
    return out


def _status(m: Rig, out, periodic):
    """The gravest thing that can be said of a design."""
    half = 0.5 * m.stops.pump_stroke
    status = jnp.where(periodic, Status.OK, Status.NOT_PERIODIC)
    status = jnp.where(out["amplitude_ratio"] < 0.5, Status.STALLED, status)
    status = jnp.where(out["peak_stroke"] > half, Status.HIT_STOPS, status)
    beyond = out["peak_stroke"] > 1.2 * half
    if "_lift" in out:
        give = 0.5 * m.valve.valve_seat_diameter
        beyond |= (out["_lift"] > m.valve.valve_max_lift + give) | (out["_-lift"] > give) | (out["_-pressure"] > 0.0)
    status = jnp.where(beyond, Status.OUT_OF_RANGE, status)
    finite = jnp.stack([jnp.isfinite(v) for n, v in out.items() if n != "residual"]).all()
    return jnp.where(finite, status, Status.NOT_FINITE)
