"""Find spikes and drop-outs: short excursions that neither other cycles, nor the model, nor the signal nearby have.

The activity of a signal is its distance from a running median, which passes slopes and steps but no excursion shorter
than half its window. A spike is far more active than the noise, than the signal around it, than the model at about the
same time, and than the same phase of most other cycles. A sharp event of the machine, such as a valve that closes,
repeats in other cycles or occurs in the model.
"""

import numpy as np
from scipy.ndimage import maximum_filter1d, median_filter

from edhas_jax.measurements.campaign import BenchRun
from edhas_jax.measurements.checks.noise_records import on_even_grid

WINDOWS = (9, 41)  # samples; excursions of up to half as many samples are found
MIN_ACTIVITY_OVER_NOISE = 8.0  # of a spike, where other cycles can be compared
MIN_ACTIVITY_WITHOUT_CYCLES = 25.0  # the same, in the first cycle and in runs without cycles
MIN_ACTIVITY_RATIO = 2.5  # of a spike over the activity elsewhere
EDGE_ACTIVITY_RATIO = 1.5  # of samples beside a spike that belong to it
EDGE_ACTIVITY_OVER_NOISE = 6.0
MAX_ACTIVITY_OVER_RANGE = 1.5  # of anything but a spike, over the range of the signal
MODEL_TOLERANCE = 2e-3  # s by which an event of the model may come earlier or later
PHASE_TOLERANCE = 5  # samples by which an event may move from cycle to cycle
MAX_SPIKES_SHARE = 0.02  # of the samples; more are not isolated


def find_spikes(
    run: BenchRun, name: str, noise: float, model: np.ndarray | None, period: float | None, ramp_time: float
) -> np.ndarray:
    """Find the samples of a signal that belong to spikes or drop-outs.

    Args:
        run: the run.
        name: name of the signal.
        noise: standard deviation of its noise (SI).
        model: the same signal of the model at the same times (samples,), SI; None if there is none.
        period: length of a cycle [s]; None for a run without cycles.
        ramp_time: time from which the cycles repeat [s].

    Returns:
        A mask (samples,).
    """
    values = run.signals[name]
    found = np.zeros(len(values), bool)
    finite = np.isfinite(values)
    if finite.sum() < 2 * max(WINDOWS) or len(on_even_grid(run, name)) > 2 * len(values):
        return found
    # missing samples are bridged, so that they neither hide nor cause an excursion
    bridged = np.interp(run.time, run.time[finite], values[finite])
    span = float(np.subtract(*np.percentile(bridged, [99, 1])))
    for window in WINDOWS:
        activity = _activity(bridged, window)
        elsewhere = np.maximum(_around(activity, window), noise)
        if model is not None:
            reach = 2 * max(window, round(MODEL_TOLERANCE / run.interval)) + 1
            elsewhere = np.maximum(elsewhere, maximum_filter1d(_activity(model, window), reach))
        has_cycles = np.zeros(len(values), bool)
        if period is not None:
            others, count = _other_cycles(activity, run.interval, period)
            elsewhere = np.maximum(elsewhere, others)
            has_cycles = (run.time > ramp_time) & (count > 0)
        limit = np.where(has_cycles, MIN_ACTIVITY_OVER_NOISE, MIN_ACTIVITY_WITHOUT_CYCLES) * noise
        spikes = (activity > limit) & (activity > MIN_ACTIVITY_RATIO * elsewhere)
        spikes |= activity > MAX_ACTIVITY_OVER_RANGE * span + MIN_ACTIVITY_WITHOUT_CYCLES * noise
        edges = (activity > EDGE_ACTIVITY_OVER_NOISE * noise) & (activity > EDGE_ACTIVITY_RATIO * elsewhere)
        found |= _with_neighbours(spikes, edges)
    found &= finite
    return found if found.sum() <= max(window, MAX_SPIKES_SHARE * len(found)) else np.zeros(len(values), bool)


def _activity(values: np.ndarray, window: int) -> np.ndarray:
    """Distance from the running median (samples,)."""
    return np.abs(values - median_filter(values, window, mode="nearest"))


def _around(activity: np.ndarray, window: int) -> np.ndarray:
    """The largest activity before or after an excursion of half a window, within two windows (samples,)."""
    guard, reach = window // 2 + 1, 2 * window
    one_side = maximum_filter1d(activity, reach - guard)
    offset = guard + (reach - guard) // 2
    padded = np.pad(one_side, offset, mode="reflect")
    return np.maximum(padded[: len(activity)], padded[2 * offset :])


def _other_cycles(activity: np.ndarray, interval: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """The activity at about the same phase that half of the other cycles reach, and their number (samples,)."""
    n, per_cycle = len(activity), period / interval
    nearby, index = maximum_filter1d(activity, 2 * PHASE_TOLERANCE + 1), np.arange(n)
    cycles = int(n / per_cycle) + 1
    rows = np.full((2 * cycles, n), -1.0)
    for row, k in zip(rows, (*range(-cycles, 0), *range(1, cycles + 1)), strict=True):
        at = np.round(index + k * per_cycle).astype(int)
        inside = (at >= 0) & (at < n)
        row[inside] = nearby[at[inside]]
    count = (rows >= 0.0).sum(axis=0)
    rows = -np.sort(-rows, axis=0)
    return np.maximum(rows[np.maximum(count - 1, 0) // 2, index], 0.0), count


def _with_neighbours(spikes: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Spikes together with the edge samples that are connected to them."""
    found = spikes.copy()
    for _ in range(max(WINDOWS)):
        grown = found | (edges & (np.append(found[1:], False) | np.append(False, found[:-1])))
        if (grown == found).all():
            break
        found = grown
    return found
