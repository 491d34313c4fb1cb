"""Detect wrong units, and pressures that are not absolute.

A unit is suspected where the ratio of a signal to the model is far from 1 and close to the ratio of two units. A poor
model is off by any factor. Therefore the signal must have the shape of the model's, and the factor must be more than
the uncertain parameters can explain.
"""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.units import difference_to_si, format_quantity
from edhas_jax.core.wording import listed
from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun
from edhas_jax.measurements.unknown_parameters import ParameterScale, uncertain_unknowns

MIN_FACTOR = 5.0  # factor between signal and model below which a wrong model may be the cause
UNIT_TOLERANCE = 1.15  # factor within which the ratio of signal and model must match the ratio of two units
MIN_CORRELATION = 0.95  # of signal and model
MAX_PRIOR_DISTANCE = 3.0  # standard deviations of the uncertain parameters, together, that explain a factor
RUN_TOLERANCE = 1.3  # factor within which the ratios of all runs must agree to count as one
NOISE_TOLERANCE = 2.7  # factor within which the noise of one run, from its fast part, must be that much larger too
ATMOSPHERE = 101325.0  # Pa
MAX_GAUGE_DEVIATION = 0.05  # of the atmosphere, by which a gauge pressure may miss it at the start
MAX_UNCERTAIN_START = 0.3  # of the atmosphere: with more noise the first samples do not show it
MIN_BELOW_VACUUM = 0.1  # of the atmosphere; the zero of a sensor may be off by less
MIN_BELOW_NOISE = 5.0  # standard deviations of the noise, which hardly a sample of it exceeds
MIN_SAMPLES_BELOW = 5  # single ones are outliers, which are left out
MAX_DRIVES = 3  # that a question names
COMMON_UNITS = {
    "Pa": ("Pa", "kPa", "bar", "MPa", "psi"), "m": ("µm", "mm", "cm", "m", "inch"), "A": ("mA", "A"),
    "m^3/s": ("mL/min", "mL/s", "L/h", "L/min", "L/s", "m^3/h", "m^3/s"), "V": ("mV", "V"), "m/s": ("mm/s", "m/s"),
    "N": ("N", "kN"),
}  # fmt: skip
LARGEST_SHARE_BEYOND = 0.5  # of samples outside the limits: noise puts half of those at a limit there


def check_units(campaign: Campaign, run: BenchRun, name: str, models: SignalsByRun, noise_ratio: float) -> list[Remark]:
    """Check the unit of one signal of one run against the model.

    Args:
        campaign: gives the stated units and the other runs.
        run: the run.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.
        noise_ratio: fast part of the noise of this run over the noise of the signal; see `noise_ratios`.

    Returns:
        A warning if the signal seems to be in another unit than stated, or is a pressure that is not absolute.
    """
    factor, stated, unit = _factor(run, name, models), campaign.channels[name].unit, campaign.machine.signals[name].unit
    if factor is None or not _has_shape(run.signals[name], models[run.name][name]):
        return []

    def warning(sentence: str) -> list[Remark]:
        return [Remark(Severity.WARNING, run.file, 1, f"{name}: {sentence}")]

    if max(factor, 1.0 / factor) < MIN_FACTOR:
        noise = campaign.channels[name].noise
        if unit == "Pa" and _is_below_vacuum(run.signals[name], models[run.name][name], noise):
            lowest = format_quantity(float(np.nanmin(run.signals[name])), "Pa")
            question = "is it a gauge pressure, or is its mean removed? Pressures must be absolute"
            return warning(f"falls to {lowest}, below zero where the model never is; {question}")
        if unit != "Pa" or not _is_gauge(run.signals[name], models[run.name][name], noise):
            return []
        question = "is it a gauge pressure? Pressures must be absolute"
        return warning(f"reads {format_quantity(ATMOSPHERE, 'Pa')} below the model from the start; {question}")
    size = difference_to_si(f"1 {stated}", unit)
    ratios = {other: size / difference_to_si(f"1 {other}", unit) for other in COMMON_UNITS.get(unit, ())}
    candidates = [o for o, ratio in ratios.items() if _ratio_of(factor, ratio) < UNIT_TOLERANCE and o != stated]
    actual = min(candidates, key=lambda other: _ratio_of(factor, ratios[other]), default=None)
    ratio = 10.0 ** round(np.log10(factor)) if actual is None else ratios[actual]
    is_explained = abs(math.log(factor)) < MAX_PRIOR_DISTANCE * _spread(campaign)
    if is_explained or _ratio_of(factor, ratio) > UNIT_TOLERANCE:
        return []
    factors = [f for other in campaign.runs if (f := _factor(other, name, models)) is not None]
    in_all = len(factors) > 1 and max(factors) / min(factors) < RUN_TOLERANCE
    if not in_all and len(factors) > 1 and _ratio_of(noise_ratio, ratio) >= NOISE_TOLERANCE:
        return []
    where = "in every run" if in_all else "in this run"
    question = "is the unit right?" if actual is None else f"are these numbers in {actual}, read as {stated}?"
    names = ["set point" if drive == "reference" else drive.replace("_", " ") for drive in run.recordings]
    drives = listed(names, MAX_DRIVES)
    question += f" Or is what drove the model, {drives}, in another unit?" if drives else ""
    return warning(f"is {factor:.3g} times the value of the model {where}; {question}")


def _factor(run: BenchRun, name: str, models: Mapping) -> float | None:
    """Standard deviation of a signal over that of the model; None when either is constant."""
    if run.name not in models or np.isfinite(run.signals.get(name, np.nan)).sum() < 2:
        return None
    measured, modelled = np.nanstd(run.signals[name]), np.std(models[run.name][name])
    return float(measured / modelled) if measured > 0.0 and modelled > 0.0 else None


def _is_gauge(measured: np.ndarray, modelled: np.ndarray, noise: float) -> bool:
    """Whether a pressure lies one atmosphere below the model as long as the model stays where it starts."""
    start = slice(0, max(5, len(measured) // 100))
    allowed = MAX_GAUGE_DEVIATION * ATMOSPHERE
    resting = np.logical_and.accumulate(np.abs(modelled[start] - modelled[0]) < allowed)
    below = (modelled[start] - measured[start])[resting & np.isfinite(measured[start])]
    if not len(below):
        return False
    allowed += 3.0 * noise / math.sqrt(len(below))
    return bool(abs(np.median(below) - ATMOSPHERE) < allowed < MAX_UNCERTAIN_START * ATMOSPHERE)


def _is_below_vacuum(measured: np.ndarray, modelled: np.ndarray, noise: float) -> bool:
    """Whether a pressure is below zero, beyond noise and the zero of a sensor, where the model's never is."""
    smallest = -max(MIN_BELOW_NOISE * noise, MIN_BELOW_VACUUM * ATMOSPHERE)
    return bool(modelled.min() >= 0.0 and np.sum(measured < smallest) >= MIN_SAMPLES_BELOW)


def _has_shape(measured: np.ndarray, modelled: np.ndarray) -> bool:
    used = np.isfinite(measured) & np.isfinite(modelled)
    return bool(np.corrcoef(measured[used], modelled[used])[0, 1] > MIN_CORRELATION)


def _spread(campaign: Campaign) -> float:
    """Standard deviation of the logarithm of a product of all uncertain parameters."""
    spreads = [
        u.spread if u.scale is ParameterScale.LOGARITHMIC else u.spread / max(abs(u.centre), np.finfo(float).tiny)
        for u in uncertain_unknowns(campaign)
    ]
    return math.hypot(*spreads)


def _ratio_of(a: float, b: float) -> float:
    """The larger of two positive numbers over the smaller."""
    return max(a / b, b / a) if a > 0.0 else np.inf


def limits_remarks(campaign: Campaign) -> Iterator[Remark]:
    """A warning for each sensor whose stated limits exclude most of what it has measured."""
    for name, channel in campaign.channels.items():
        values = np.concatenate([run.signals[name] for run in campaign.runs if name in run.signals] or [[]])
        values, (low, high) = values[np.isfinite(values)], channel.limits
        share = np.mean((values < low) | (values > high)) if len(values) else 0.0
        if not share > LARGEST_SHARE_BEYOND:
            continue
        about = campaign.machine.signals[name]
        sizes = {unit: difference_to_si(f"1 {unit}", about.unit) for unit in COMMON_UNITS.get(about.unit, ())}
        fitting = [u for u, size in sizes.items() if low * size <= values.min() and values.max() <= high * size]
        unit = min(fitting, key=sizes.__getitem__, default=None)
        asked = f"are they in {unit}?" if unit else "are they those of this sensor?"
        ends = " … ".join(format_quantity(end, about.unit) for end in (low, high))
        sentence = f"{name}: {100 * share:.0f} % of the samples lie outside the stated limits {ends}; {asked}"
        yield campaign.remark(Severity.WARNING, sentence)
