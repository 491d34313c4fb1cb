"""Metrics of one cycle of a design, summed up in the time loop, and the status that says whether to trust them."""

import enum
from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.core import structs
from edhas_jax.machine.components.set_points import CyclicSine
from edhas_jax.machine.rigs import ActuatorBench, Rig
from edhas_jax.simulation.integrator import step_with_outputs


class Status(enum.IntEnum):
    """The outcome of a design; anything but OK says why its metrics are not to be trusted."""

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
    Status.STEP_TOO_LARGE: "slow to become periodic, and flow, power or stroke depend on the step: take a smaller one",
}


def cycle_step(m: Rig, y, sums, n, steps, first) -> tuple[dict[str, Any], dict[str, Any]]:
    """One time step of a cycle, with its contribution to the sums and peaks from which metrics are computed.

    Args:
        m: the machine, driven by a sine.
        y: its state.
        sums: sums and peaks of the cycle so far, see `empty_sums`.
        n: number of the step in the cycle, from 0.
        steps: steps per cycle.
        first: true in the first cycle, where a ramp brings the set point in.

    Returns:
        The new state, and the new sums.
    """
    phase = (n + 0.5) / steps
    h = 1.0 / (m.reference.frequency * steps)
    y, seen = _observed_step(structs.replace(m, reference=CyclicSine.at_phase(m.reference, phase, first)), y, h)
    return y, _accumulated(m, sums, seen, phase)


PERIODIC = ("mean_flow", "mean_electrical_power", "peak_stroke")  # their change tells whether a design is periodic


def cycle_change(new: dict[str, Any], old: dict[str, Any]):
    """The largest relative change from one cycle to the next among the metrics `PERIODIC`."""
    present = [n for n in PERIODIC if n in new]
    return jnp.max(jnp.stack([_relative_change(new[n], old[n]) for n in present]), axis=0)


def _relative_change(new, old):
    return jnp.abs(new - old) / (jnp.abs(new) + jnp.finfo(new.dtype).tiny)


def _observed_signals(m: Rig) -> tuple[str, ...]:
    actuator = ("voltage", "coil_voltage", "current", "resistance", "piston_position", "piston_velocity", "reference")
    if isinstance(m, ActuatorBench):
        return actuator
    return (*actuator, "outlet_flow", "outlet_pressure", "accumulator_pressure", "load_drop", "leakage_a", "leakage_b")


def _observed_step(m: Rig, y, h):
    y, _, seen = step_with_outputs(m, y, 0.0, h, lambda s: {n: getattr(s, n) for n in _observed_signals(m)})
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
    zeros = {n: np.zeros((), dtype) for n in SUMS + (PUMP_SUMS if pump else ())}
    return zeros | {f"peak {n}": np.full((), -np.inf, dtype) for n in PEAKS + (PUMP_PEAKS if pump else ())}


def _accumulated(m: Rig, sums, s, phase) -> dict[str, Any]:
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


def cycle_metrics(m: Rig, sums, share) -> dict[str, Any]:
    """The metrics of a cycle from its sums; names and units as in `edhas_jax.simulation.metrics`.

    Args:
        m: the machine.
        sums: what `cycle_step` has summed up.
        share: 1/steps of the cycle.
    """
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


def design_status(m: Rig, out, periodic):
    """The most severe `Status` that applies to a design with these metrics; `periodic`: its cycles have converged."""
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
