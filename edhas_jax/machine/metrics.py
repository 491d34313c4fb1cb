"""The metrics of the rigs of the package."""

import math

import numpy as np

from edhas_jax.machine.effects import PistonLeakage
from edhas_jax.machine.interface.metrics import Mean, Metric, Peak, WholeRun, angle, largest, metric, root

SETTLING_BAND = 0.02  # share of the step within which the cylinder counts as settled


def _supplied_power(m, s):
    """The electrical power [W]: a current amplifier gives what the coil takes, whatever its command."""
    supplied = s.voltage if "current" in m.amplifier.initial() else s.coil_voltage
    return supplied * s.current


POWER = Mean(_supplied_power, ("electrical input",))
STROKE = Peak(lambda m, s: abs(s.piston_position))

ELECTRICAL: dict[str, Metric] = {
    "mean_electrical_power": metric("W", "mean of voltage × current", POWER, rank=2),
    "rms_current": metric("A", "rms current", Mean(lambda m, s: s.current * s.current), lambda m, x: root(x)),
    "peak_current": metric("A", "largest current", Peak(lambda m, s: abs(s.current)), rank=9),
    "rms_voltage": metric("V", "rms voltage", Mean(lambda m, s: s.voltage * s.voltage), lambda m, x: root(x)),
    "peak_voltage": metric("V", "largest voltage", Peak(lambda m, s: abs(s.voltage)), rank=4),
    "copper_loss": metric(
        "W", "mean loss in the coil", Mean(lambda m, s: s.resistance * s.current * s.current, ("copper",)), rank=10
    ),
    "peak_stroke": metric("m", "largest distance from mid-stroke", STROKE, shown="mm", rank=13),
}

# real and imaginary part of first harmonics, of piston and set point
HARMONICS = (
    Mean(lambda m, s: s.piston_position * s.sine), Mean(lambda m, s: s.piston_position * s.cosine),
    Mean(lambda m, s: s.reference * s.sine), Mean(lambda m, s: s.reference * s.cosine),
)  # fmt: skip


def _set_point_moves(m, x0, x1, r0, r1):
    return (abs(r0) > 0.0) | (abs(r1) > 0.0)


TRACKING: dict[str, Metric] = {
    "tracking_error": metric(
        "m", "rms of set point − piston", Mean(lambda m, s: (s.reference - s.piston_position) ** 2),
        lambda m, x: root(x), shown="µm", rank=8, of_cycle=True,
    ),
    "amplitude_ratio": metric(
        "-", "first harmonic, piston over set point", HARMONICS,
        lambda m, x0, x1, r0, r1: root((x0**2 + x1**2) / (r0**2 + r1**2)),
        rank=6, defined=_set_point_moves, of_cycle=True,
    ),
    "phase_lag": metric(
        "rad", "first harmonic, piston after set point", HARMONICS,
        lambda m, x0, x1, r0, r1: angle(x0 * r1 - x1 * r0, x0 * r0 + x1 * r1),
        shown="deg", defined=_set_point_moves, of_cycle=True,
    ),
}  # fmt: skip


def swept_area(machine):
    """The area [m²] with which a pump displaces oil: that of a plunger, and half of the gap that leakage gives it.

    The oil in the gap is dragged along by the plunger, with half of its speed on average.
    """
    gaps = [e.piston_clearance for e in machine.effects if isinstance(e, PistonLeakage)]
    return machine.pump.area() + sum(0.5 * math.pi * machine.pump.piston_diameter * gap for gap in gaps)


FLOW = Mean(lambda m, s: s.outlet_flow, ("outlet_flow",))
SPEED = Mean(lambda m, s: abs(s.piston_velocity))
DELIVERED = Mean(lambda m, s: s.outlet_flow * s.load_drop, ("load orifice", "load"))
PRESSURE, LOWEST_PRESSURE = Peak(lambda m, s: s.outlet_pressure), Peak(lambda m, s: -s.outlet_pressure)

HYDRAULIC: dict[str, Metric] = {
    "mean_flow": metric("m^3/s", "mean flow to the load", FLOW, shown="L/min", rank=1),
    "mean_leakage": metric(
        "m^3/s", "mean flow past both plungers",
        Mean(lambda m, s: s.leakage_a + s.leakage_b, ("leakage_a", "leakage_b")), shown="L/min", rank=5,
    ),
    "peak_leakage": metric(
        "m^3/s", "largest flow past one plunger", Peak(lambda m, s: largest(abs(s.leakage_a), abs(s.leakage_b))),
        shown="L/min",
    ),
    "peak_outlet_pressure": metric("Pa", "largest outlet pressure, absolute", PRESSURE, shown="MPa", rank=12),
    "pressure_rise": metric(
        "Pa", "largest outlet pressure above the accumulator",
        Peak(lambda m, s: s.outlet_pressure - s.accumulator_pressure), shown="MPa",
    ),
    "pressure_ripple": metric(
        "Pa", "outlet pressure, peak to peak", (PRESSURE, LOWEST_PRESSURE),
        lambda m, high, low: high + low, shown="MPa", rank=11,
    ),
    "volumetric_efficiency": metric(
        "-", "mean flow over swept volume, half of the gap swept too", (FLOW, SPEED),
        lambda m, flow, speed: flow / (swept_area(m) * speed), shown="%", rank=7,
        defined=lambda m, flow, speed: speed > 0.0,
    ),
    "delivered_power": metric("W", "mean power at the load", DELIVERED),
    "overall_efficiency": metric(
        "-", "delivered over electrical power", (DELIVERED, POWER), lambda m, delivered, power: delivered / power,
        shown="%", rank=3, defined=lambda m, delivered, power: power > 0.0,
    ),
}  # fmt: skip


def _response(m, s):
    """The cylinder's way as a share of the step; NaN where the target is no step."""
    step = s.target[-1] - s.cylinder_position[0]
    is_step = step != 0.0 and np.ptp(s.target[1:]) == 0.0
    return (s.cylinder_position - s.cylinder_position[0]) / step if is_step else np.full(len(s.time), np.nan)


def _response_time(m, s):
    error = np.abs(_response(m, s) - 1.0)
    outside = np.flatnonzero(error > SETTLING_BAND)
    if not len(outside) or outside[-1] + 1 == len(s.time):
        return np.nan
    k = outside[-1]
    return np.interp(SETTLING_BAND, error[[k + 1, k]], s.time[[k + 1, k]])


def _is_known(m, x):
    return ~np.isnan(x)


RESPONSE: dict[str, Metric] = {
    "steady_error": metric(
        "m", "target − cylinder at the end of the run",
        WholeRun(lambda m, s: s.target[-1] - s.cylinder_position[-1]), shown="µm",
    ),
    "response_time": metric(
        "s", f"until the cylinder stays within {SETTLING_BAND:.0%} of the step", WholeRun(_response_time), shown="s",
        defined=_is_known,
    ),
    "overshoot": metric(
        "-", "beyond the target, of the step", WholeRun(lambda m, s: np.maximum(0.0, _response(m, s).max() - 1.0)),
        shown="%", defined=_is_known,
    ),
}  # fmt: skip

METRICS: dict[str, Metric] = ELECTRICAL | TRACKING | HYDRAULIC | RESPONSE
