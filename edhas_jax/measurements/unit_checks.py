"""Unit slips: a signal that is ten times what the model gives was read in the wrong unit, not by a wrong model."""

from collections.abc import Iterator, Mapping

import numpy as np

from edhas_jax.core.units import format_quantity, to_si
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.campaign import BenchRun, Campaign, Remark, Severity
from edhas_jax.measurements.signal_checks import noise_ratio

LEAST = 5.0  # a factor between signal and model below which a wrong model may be to blame
NEAR = 1.35  # how near to the ratio of two units a factor must be
SAME = 1.3  # how near the factors of all runs must be to each other to be one
ATMOSPHERE = 101325.0
USED = {
    "Pa": ("Pa", "kPa", "bar", "MPa", "psi"), "m": ("µm", "mm", "cm", "m", "inch"), "A": ("mA", "A"),
    "m^3/s": ("mL/min", "mL/s", "L/h", "L/min", "L/s", "m^3/h", "m^3/s"), "V": ("mV", "V"), "m/s": ("mm/s", "m/s"),
    "N": ("N", "kN"),
}  # fmt: skip


def check_units(
    campaign: Campaign, run: BenchRun, name: str, models: Mapping[str, Mapping[str, np.ndarray]]
) -> Iterator[Remark]:
    """What speaks for another unit than the one stated; `models` has, by run, the model's signals at its samples."""
    factor = _factor(run, name, models)
    if factor is None:
        return
    stated, unit = campaign.channels[name].unit, SIGNALS[name].unit

    def warn(sentence: str) -> Remark:
        return Remark(Severity.WARNING, run.file, 1, f"{name}: {sentence}")

    if max(factor, 1.0 / factor) < LEAST:
        if unit == "Pa" and _is_gauge(run.signals[name], models[run.name][name]):
            low = format_quantity(ATMOSPHERE, "Pa")
            yield warn(f"reads {low} below the model from the start; is it a gauge pressure? Pressures are absolute")
        return
    size = _size(stated, unit)
    ratios = {other: size / _size(other, unit) for other in USED.get(unit, ())}
    near = [other for other, ratio in ratios.items() if _apart(factor, ratio) < NEAR and other != stated]
    meant = min(near, key=lambda other: _apart(factor, ratios[other]), default=None)
    ratio = 10.0 ** round(np.log10(factor)) if meant is None else ratios[meant]
    if _apart(factor, ratio) > NEAR:
        return
    factors = [_factor(other, name, models) for other in campaign.runs]
    factors = [f for f in factors if f is not None]
    in_all = len(factors) > 1 and max(factors) / min(factors) < SAME
    as_noise = _apart(noise_ratio(campaign, run, name), ratio) < 2.0 * NEAR
    if in_all or as_noise or len(factors) == 1:
        where = "in every run" if in_all else "in this run"
        why = "a slip of units?" if meant is None else f"are these numbers in {meant}, read as {stated}?"
        yield warn(f"is {factor:.3g} times what the model gives {where}; {why}")


def _factor(run: BenchRun, name: str, models: Mapping) -> float | None:
    """How many times larger than the model's a signal moves; None when either does not move."""
    if run.name not in models or np.isfinite(run.signals.get(name, np.nan)).sum() < 2:
        return None
    measured, modelled = np.nanstd(run.signals[name]), np.std(models[run.name][name])
    return float(measured / modelled) if measured > 0.0 and modelled > 0.0 else None


def _is_gauge(measured: np.ndarray, modelled: np.ndarray) -> bool:
    start = slice(0, max(5, len(measured) // 100))
    return abs(np.nanmedian(modelled[start] - measured[start]) / ATMOSPHERE - 1.0) < 0.1


def _size(unit: str, si: str) -> float:
    return to_si(f"1 {unit}", si) - to_si(f"0 {unit}", si)


def _apart(a: float, b: float) -> float:
    """How many times the larger of two is the smaller."""
    return max(a / b, b / a) if a > 0.0 else np.inf
