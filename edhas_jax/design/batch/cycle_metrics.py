"""Metrics of one cycle of a design, summed up in the time loop."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.one_sided_minmax import one_sided_max
from edhas_jax.core import structs
from edhas_jax.machine.components.set_points import CyclicSine
from edhas_jax.machine.rigs import ActuatorBench, Rig
from edhas_jax.simulation.integrator import step_with_outputs
from edhas_jax.simulation.metrics import swept_area
from edhas_jax.simulation.validity import BEYOND_RANGE, valid_ranges


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
    ranges = valid_ranges(m)
    names = dict.fromkeys([*_observed_signals(m), *(n for n in ranges if n not in y)])
    y, _, seen = step_with_outputs(m, y, 0.0, h, lambda s: {n: getattr(s, n) for n in names})
    beyond = None
    for name, (low, high) in ranges.items():
        value = y.get(name, seen.get(name))
        for excess in (low - value, value - high):
            beyond = excess if beyond is None else one_sided_max(excess, beyond)
    return y, seen | {"beyond range": beyond}


SUMS = ("power", "copper", "current²", "voltage²", "error²", "x sin", "x cos", "r sin", "r cos")
PUMP_SUMS = ("flow", "leakage", "swept", "delivered")
PEAKS = ("current", "voltage", "stroke", "beyond range")
PUMP_PEAKS = ("leakage", "pressure", "rise", "-pressure")


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
    peaks["beyond range"] = s["beyond range"]
    if "outlet_flow" in s:
        rise = s["outlet_pressure"] - s["accumulator_pressure"]
        new |= {
            "flow": s["outlet_flow"], "leakage": s["leakage_a"] + s["leakage_b"],
            "swept": jnp.abs(s["piston_velocity"]), "delivered": s["outlet_flow"] * s["load_drop"],
        }  # fmt: skip
        peaks |= {
            "leakage": one_sided_max(jnp.abs(s["leakage_a"]), jnp.abs(s["leakage_b"])), "rise": rise,
            "pressure": s["outlet_pressure"], "-pressure": -s["outlet_pressure"],
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
        BEYOND_RANGE: peak["beyond range"],
    }  # fmt: skip
    if "flow" in mean:
        out |= {
            "mean_flow": mean["flow"], "mean_leakage": mean["leakage"], "peak_leakage": peak["leakage"],
            "peak_outlet_pressure": peak["pressure"], "pressure_rise": peak["rise"],
            "pressure_ripple": peak["pressure"] + peak["-pressure"],
            "volumetric_efficiency": mean["flow"] / (swept_area(m) * mean["swept"]),
            "delivered_power": mean["delivered"], "overall_efficiency": mean["delivered"] / mean["power"],
        }  # fmt: skip
    return out
