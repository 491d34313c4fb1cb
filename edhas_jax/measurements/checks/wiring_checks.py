"""Find signals that are wired or scaled wrongly: reversed, exchanged with another one, only noise, or saturated.

All of these show only in the comparison with a model. A wrong or incomplete model also deviates, and hardly turns a
signal over or exchanges two of them; but it proves nothing, so that these are remarks only, and all data are used.
"""

import itertools
from collections.abc import Iterator, Mapping

import numpy as np

from edhas_jax.core.remark import Remark
from edhas_jax.core.units import from_si, values_to_si
from edhas_jax.measurements.campaign import BenchRun, Campaign, SignalsByRun
from edhas_jax.measurements.checks.noise_records import fast_noise

MAX_REVERSED_CORRELATION = -0.8
MAX_EXCHANGED_DIFFERENCE = 0.5  # rms difference over the standard deviation of the model, if exchanged
MAX_EXCHANGED_RATIO = 0.4  # of the rms differences if exchanged over those as recorded
MIN_NOISE_SHARE = 0.7  # of the fast scatter in the standard deviation of a signal that is only noise
MAX_CORRELATION_SHARE = 0.5  # of the correlation with the model that a signal with this much noise would have
MIN_CORRELATION_SIGNIFICANCE = 10.0  # standard deviations of the correlation of white noise with the model
SATURATION_INTERVALS = 12  # of the model's range; each has a slope of the measured over the modelled value
MAX_SATURATED_SLOPE = 0.88  # of the last two intervals over the median
MIN_INVERSE_SLOPE = 1.08  # of the modelled over the measured value, there
MAX_UNEXPLAINED_SHARE = 0.3  # of the signal's standard deviation, by which it deviates from a straight line
MIN_SATURATED_SAMPLES = 30
USED = "It is used as recorded"


def check_wiring(campaign: Campaign, run: BenchRun, models: SignalsByRun) -> Iterator[Remark]:
    """Find the signals of a run that are hardly what they are said to be.

    Args:
        campaign: gives the units of the files.
        run: the run.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.

    Yields:
        A warning on each.
    """
    model = models.get(run.name)
    if model is None:
        return

    names = [n for n, values in run.signals.items() if np.isfinite(values).sum() > 10 and np.std(model[n]) > 0.0]
    exchanged: set[str] = set()
    for one, other in itertools.combinations(names, 2):
        if not exchanged & {one, other} and _are_exchanged(campaign, run, model, one, other):
            exchanged |= {one, other}
            yield run.warning(f"{one} and {other} seem to be exchanged: each follows the other's model. {USED}")
    for name in names:
        if name in exchanged:
            continue
        measured, modelled = _finite(run.signals[name], model[name])
        if _is_only_noise(run, name, measured, modelled):
            sentence = "is only noise, without the motion that the model predicts; is it connected?"
            yield run.warning(f"{name} {sentence} {USED}")
        elif _correlation(measured, modelled) < MAX_REVERSED_CORRELATION:
            question = "is its sensor, or what drove the model, reversed?" if run.drives else "is its sensor reversed?"
            yield run.warning(f"{name} has the opposite sign of the model; {question} {USED}")


def check_saturation(campaign: Campaign, name: str, models: SignalsByRun) -> Iterator[Remark]:
    """Check whether a signal follows the model less and less towards an end of its range, in all runs together.

    Args:
        campaign: the measurements.
        name: name of the signal.
        models: signals of the model (samples,) at the time stamps, by run and signal, SI.

    Yields:
        A warning on that end.
    """
    runs = [run for run in campaign.runs if name in run.signals and run.name in models]
    if not runs:
        return
    rows = [_finite(run.signals[name], models[run.name][name]) for run in runs]
    measured, modelled = (np.concatenate(column) for column in zip(*rows, strict=True))
    if len(measured) < SATURATION_INTERVALS * MIN_SATURATED_SAMPLES or np.std(modelled) == 0.0:
        return
    line = np.polynomial.Polynomial.fit(modelled, measured, 1)
    if np.std(measured - line(modelled)) > MAX_UNEXPLAINED_SHARE * np.std(measured):
        return
    forward, inverse = _end_slopes(modelled, measured), _end_slopes(measured, modelled)
    for end, share, inverse_share in zip(("low", "high"), forward, inverse, strict=True):
        # scatter flattens the ends of either regression; a saturated sensor steepens the inverse one
        if share < MAX_SATURATED_SLOPE and inverse_share > MIN_INVERSE_SLOPE:
            slope = f"{name} follows the model with {max(share, 0.0):.0%} of its usual slope at its {end} end"
            yield runs[0].warning(f"{slope}, in all runs together; does the sensor saturate there?")


def _end_slopes(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Slope of y over x at the low and at the high end of x, over the median slope; 1 where it is not determined."""
    knots = np.linspace(x.min(), x.max(), SATURATION_INTERVALS + 1)
    hats = np.stack([np.interp(x, knots, row) for row in np.eye(len(knots))], axis=1)
    slopes = np.diff(np.linalg.lstsq(hats.T @ hats, hats.T @ y, rcond=None)[0])
    typical, width, largest = float(np.median(slopes)), 2.0 * (knots[1] - knots[0]), float(np.abs(x).max())
    shares = []
    for extreme, of_end in ((knots[0], slopes[:2]), (knots[-1], slopes[-2:])):
        near = np.abs(x - extreme) < width
        is_determined = abs(extreme) > 0.5 * largest and near.sum() >= MIN_SATURATED_SAMPLES and typical > 0.0
        shares.append(float(np.mean(of_end)) / typical if is_determined else 1.0)
    return shares[0], shares[1]


def _finite(measured: np.ndarray, modelled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    used = np.isfinite(measured) & np.isfinite(modelled)
    return measured[used], modelled[used]


def _correlation(one: np.ndarray, other: np.ndarray) -> float:
    one, other = one - one.mean(), other - other.mean()
    norm = np.sqrt((one @ one) * (other @ other))
    return float(one @ other / norm) if norm > 0.0 else 0.0


def _is_only_noise(run: BenchRun, name: str, measured: np.ndarray, modelled: np.ndarray) -> bool:
    noise = fast_noise(run, name)
    if not noise > MIN_NOISE_SHARE * np.std(measured):
        return False
    # the correlation with the model that a signal with this much noise would have
    expected = np.std(modelled) / np.hypot(np.std(modelled), noise)
    is_visible = expected * np.sqrt(len(measured)) > MIN_CORRELATION_SIGNIFICANCE
    return bool(is_visible and abs(_correlation(measured, modelled)) < MAX_CORRELATION_SHARE * expected)


def _are_exchanged(campaign: Campaign, run: BenchRun, model: Mapping[str, np.ndarray], one: str, other: str) -> bool:
    if_exchanged = {one: _read_as(campaign, run, other, one), other: _read_as(campaign, run, one, other)}
    differences = []
    for values in (if_exchanged, run.signals):
        rows = [_finite(values[name], model[name]) for name in (one, other)]
        differences.append([float(np.sqrt(np.mean((v - m) ** 2)) / np.std(m)) for v, m in rows])
    exchanged, recorded = differences
    return max(exchanged) < MAX_EXCHANGED_DIFFERENCE and sum(exchanged) < MAX_EXCHANGED_RATIO * sum(recorded)


def _read_as(campaign: Campaign, run: BenchRun, source: str, name: str) -> np.ndarray:
    """The numbers of one signal in its file, read in the unit of another (SI)."""
    unit, other_unit = (campaign.machine.signals[n].unit for n in (name, source))
    if unit == other_unit:
        return run.signals[source]
    numbers = from_si(run.signals[source], other_unit, campaign.channels[source].unit)
    return values_to_si(numbers, campaign.channels[name].unit, unit)
