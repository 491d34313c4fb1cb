"""Metrics of a run: named numbers with units, from its signals, energies and volumes."""

import math
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from edhas_jax.core.units import from_si
from edhas_jax.machine.effects import PistonLeakage
from edhas_jax.machine.rigs import ActuatorBench, ActuatorSystem, Rig

SETTLING_BAND = 0.02  # share of the step within which the cylinder counts as settled
GRID_PER_CYCLE = 400  # points per cycle of the grid on which a first harmonic is computed


class Metric(NamedTuple):
    """A metric of a run: SI value, SI unit, unit for display, meaning; as text it is in the unit for display."""

    value: float
    unit: str
    display_unit: str
    doc: str

    def __str__(self) -> str:
        return f"{self.shown()} {self.display_unit}".removesuffix(" -")

    def shown(self) -> str:
        """The number in the unit for display, with five digits."""
        return f"{from_si(self.value, self.unit, self.display_unit):.5g}"


# name: (SI unit, unit for display, meaning); the same for a single run and for a batch
METRICS: dict[str, tuple[str, str, str]] = {
    "mean_electrical_power": ("W", "W", "mean of voltage × current"),
    "rms_current": ("A", "A", "rms current"),
    "peak_current": ("A", "A", "largest current"),
    "rms_voltage": ("V", "V", "rms voltage"),
    "peak_voltage": ("V", "V", "largest voltage"),
    "copper_loss": ("W", "W", "mean loss in the coil"),
    "peak_stroke": ("m", "mm", "largest distance from mid-stroke"),
    "tracking_error": ("m", "µm", "rms of set point − piston"),
    "amplitude_ratio": ("-", "-", "first harmonic, piston over set point"),
    "phase_lag": ("rad", "deg", "first harmonic, piston after set point"),
    "mean_flow": ("m^3/s", "L/min", "mean flow to the load"),
    "mean_leakage": ("m^3/s", "L/min", "mean flow past both plungers"),
    "peak_leakage": ("m^3/s", "L/min", "largest flow past one plunger"),
    "peak_outlet_pressure": ("Pa", "MPa", "largest outlet pressure, absolute"),
    "pressure_rise": ("Pa", "MPa", "largest outlet pressure above the accumulator"),
    "pressure_ripple": ("Pa", "MPa", "outlet pressure, peak to peak"),
    "volumetric_efficiency": ("-", "%", "mean flow over swept volume, half of the gap swept too"),
    "delivered_power": ("W", "W", "mean power at the load"),
    "overall_efficiency": ("-", "%", "delivered over electrical power"),
    "steady_error": ("m", "µm", "target − cylinder at the end of the run"),
    "response_time": ("s", "s", f"until the cylinder stays within {SETTLING_BAND:.0%} of the step"),
    "overshoot": ("-", "%", "beyond the target, of the step"),
}


class RunTooShortError(ValueError):
    """A run ends before one whole cycle after the ramp."""


@np.errstate(over="ignore", invalid="ignore")  # what is not finite is told by the status
def compute_metrics(machine: Rig, signals: dict, energy: dict, volume: dict) -> dict[str, Metric]:
    """All metrics of a run.

    On a bench with a sine as set point they are taken over the whole cycles after the ramp, otherwise over the whole
    run. Means come from the energies and volumes cumulated step by step, peaks from the samples.

    Args:
        machine: the machine of the run.
        signals: SI arrays (samples,) by name, with "time" [s].
        energy: energy since the start [J] by row, each (samples,).
        volume: volume since the start [m³] by row, each (samples,).

    Returns:
        The metrics by name.

    Raises:
        RunTooShortError: the run has no whole cycle after the ramp.
    """
    t = signals["time"]
    first, last = metric_window(machine, t[-1])
    inside = (t >= first - 1e-12) & (t <= last + 1e-12)
    out = _electrical(signals, energy, t, first, last, inside)
    if machine.cycle is not None:
        out |= _tracking(machine, signals, t, first, last)
    if not isinstance(machine, ActuatorBench):
        out |= _hydraulic(machine, signals, energy, volume, t, first, last, inside)
    if isinstance(machine, ActuatorSystem):
        out |= _step_response(machine, signals, t)
    return {name: Metric(value, *METRICS[name]) for name, value in out.items()}


def metric_window(machine: Rig, end: float) -> tuple[float, float]:
    """The time [s] from which and to which metrics are taken: the whole cycles after the ramp, or the whole run.

    Args:
        machine: the machine.
        end: end of the run [s].

    Raises:
        RunTooShortError: there is no whole cycle after the ramp.
    """
    if machine.cycle is None:
        return 0.0, end
    period = 1.0 / float(machine.reference.frequency)
    ramp = float(machine.reference.ramp_time)
    cycles = math.floor((end - ramp) / period + 1e-9)
    if cycles < 1:
        raise RunTooShortError(
            f"no whole cycle after the ramp: the run ends at {end:.4g} s, the ramp at {ramp:.4g} s, "
            f"a cycle takes {period:.4g} s; let it run for at least {ramp + period:.4g} s"
        )
    return end - cycles * period, end


def mean_rate(t, cumulated, first: float, last: float, rate=None) -> float:
    """The mean of a rate between two times that need not be samples, from its integral at the samples.

    Args:
        t: times of the samples [s], (samples,).
        cumulated: integral of the rate, (samples,).
        first: start of the interval [s].
        last: end of the interval [s].
        rate: the rate at the samples; with it the integral is interpolated by cubics, otherwise linearly.
    """
    if rate is None:
        ends = np.interp([first, last], t, cumulated)
    else:
        ends = CubicHermiteSpline(t, cumulated, rate)([first, last])
    return float((ends[1] - ends[0]) / (last - first))


def _rms(values, t, first, last) -> float:
    """The rms of a signal between two times."""
    squares = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (values[1:] ** 2 + values[:-1] ** 2))])
    return math.sqrt(max(0.0, mean_rate(t, squares, first, last, values**2)))


def _electrical(signals, energy, t, first, last, inside) -> dict[str, float]:
    """Metrics of voltage, current and stroke."""
    i, u = signals["current"], signals["voltage"]
    return {
        "mean_electrical_power": mean_rate(t, energy["electrical input"], first, last, signals["coil_voltage"] * i),
        "rms_current": _rms(i, t, first, last),
        "peak_current": float(np.abs(i[inside]).max()),
        "rms_voltage": _rms(u, t, first, last),
        "peak_voltage": float(np.abs(u[inside]).max()),
        "copper_loss": mean_rate(t, energy["copper"], first, last),
        "peak_stroke": float(np.abs(signals["piston_position"][inside]).max()),
    }


def _harmonic(values, t, first, last, frequency) -> complex:
    """The complex first harmonic over whole cycles, on a grid of its own so that samples need not fit the cycle."""
    grid = np.linspace(first, last, 1 + GRID_PER_CYCLE * max(1, round((last - first) * frequency)))[:-1]
    return 2.0 * np.mean(np.interp(grid, t, values) * np.exp(-2j * np.pi * frequency * grid))


def _tracking(machine, signals, t, first, last) -> dict[str, float]:
    """Metrics of the piston's motion against its set point, over whole cycles."""
    f = float(machine.reference.frequency)
    set_point = _harmonic(signals["reference"], t, first, last, f)
    piston = _harmonic(signals["piston_position"], t, first, last, f)
    inside = (t >= first) & (t <= last)
    error = (signals["reference"] - signals["piston_position"])[inside]
    out = {"tracking_error": float(np.sqrt(np.mean(error**2)))}
    if abs(set_point) > 0.0:
        out |= {"amplitude_ratio": abs(piston) / abs(set_point), "phase_lag": float(-np.angle(piston / set_point))}
    return out


def _hydraulic(machine, signals, energy, volume, t, first, last, inside) -> dict[str, float]:
    """Metrics of flow, pressure and efficiency."""
    p, q = signals["outlet_pressure"], signals["outlet_flow"]
    leakages = signals["leakage_a"], signals["leakage_b"]
    flow = mean_rate(t, volume["outlet_flow"], first, last, q)
    speed = np.abs(signals["piston_velocity"])
    travel = np.concatenate([[0.0], np.cumsum(0.5 * np.diff(t) * (speed[1:] + speed[:-1]))])
    swept_flow = float(swept_area(machine)) * mean_rate(t, travel, first, last)
    hydraulic = mean_rate(t, energy["load orifice" if "load orifice" in energy else "load"], first, last)
    electrical = mean_rate(t, energy["electrical input"], first, last)
    out = {
        "mean_flow": flow,
        "mean_leakage": mean_rate(t, volume["leakage_a"] + volume["leakage_b"], first, last, sum(leakages)),
        "peak_leakage": float(np.abs(np.stack(leakages)[:, inside]).max()),
        "peak_outlet_pressure": float(p[inside].max()),
        "pressure_rise": float((p - signals["accumulator_pressure"])[inside].max()),
        "pressure_ripple": float(np.ptp(p[inside])),
        "volumetric_efficiency": flow / swept_flow if swept_flow > 0 else 0.0,
        "delivered_power": hydraulic,
    }
    if electrical > 0:
        out["overall_efficiency"] = hydraulic / electrical
    return out


def swept_area(machine):
    """The area [m²] with which a pump displaces oil: that of a plunger, and half of the gap that leakage gives it.

    The oil in the gap is dragged along by the plunger, with half of its speed on average.
    """
    gaps = [e.piston_clearance for e in machine.effects if isinstance(e, PistonLeakage)]
    return machine.pump.area() + sum(0.5 * math.pi * machine.pump.piston_diameter * gap for gap in gaps)


def _step_response(machine, signals, t) -> dict[str, float]:
    """Metrics of the cylinder's response to a step of its target."""
    x, target = signals["cylinder_position"], signals["target"]
    step_size = target[-1] - x[0]
    out = {"steady_error": float(target[-1] - x[-1])}
    if step_size != 0.0 and np.ptp(target[1:]) == 0.0:
        response = (x - x[0]) / step_size
        outside = np.flatnonzero(response < 1.0 - SETTLING_BAND)
        if outside[-1] + 1 < len(t):
            k = outside[-1]
            out["response_time"] = float(np.interp(1.0 - SETTLING_BAND, response[k : k + 2], t[k : k + 2]))
        out["overshoot"] = float(max(0.0, response.max() - 1.0))
    return out
