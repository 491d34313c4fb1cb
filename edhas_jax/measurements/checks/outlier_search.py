"""Find single wrong samples of moderate size: a few standard deviations of the noise away from their neighbours.

Where the signal is smooth, its neighbours predict a sample. A sharp event of the machine, such as a valve that closes,
disturbs the neighbours too, or repeats at the same phase of other cycles, or occurs in the model at about that time.

How many samples are called wrong is decided for all of a signal together: the expected share of mistakes among them is
limited.

Source: Benjamini, Hochberg, Controlling the false discovery rate, J. R. Stat. Soc. B 57 (1995).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import maximum_filter1d

from edhas_jax.measurements.checks.gap_test import GapDeviations, GapTest

GAPS = (1, 2, 3)  # successive samples that are tested together
NEIGHBOURS = 6  # samples on either side that predict a signal
MIN_EXCESS = 2.5  # of a wrong sample's deviation over that at the same phase of other cycles, and over the model's
PHASE_TOLERANCE = 3  # samples by which an event may move from cycle to cycle
MODEL_TOLERANCE = 2e-3  # s by which an event of the model may come earlier or later
MAX_FALSE_SHARE = 1e-3  # expected share of mistakes


class Record(NamedTuple):
    """Samples of one run on an even grid: values and model (samples,), sample interval and length of a cycle [s].

    `model` is None where there is none, `period` for a run without cycles. The cycles repeat from sample `settled` on.
    """

    values: np.ndarray
    model: np.ndarray | None
    interval: float
    period: float | None
    settled: int


def find_outliers(records: Sequence[Record], noise: float, correlation: Sequence[float]) -> list[np.ndarray]:
    """Find the wrong samples of a signal in all its runs.

    Args:
        records: the runs; missing samples are NaN.
        noise: standard deviation of the noise (SI).
        correlation: autoregressive coefficients of the noise.

    Returns:
        A mask (samples,) for each record.
    """
    found = [np.zeros(len(record.values), bool) for record in records]
    for gap in GAPS:
        test = GapTest(gap, NEIGHBOURS, noise, correlation)
        rows = [_suspects(_bridged(r, mask), test) for r, mask in zip(records, found, strict=True)]
        limit = _largest_probability([p for row in rows for p in row.probability], sum(map(len, found)))
        for mask, row in zip(found, rows, strict=True):
            for first in row.first[row.probability <= limit]:
                mask[first : first + gap] = True
    return found


def _bridged(record: Record, wrong: np.ndarray) -> Record:
    """A record with a straight line in place of the samples that are known to be wrong."""
    return record._replace(values=bridged(record.values, wrong))


def bridged(values: np.ndarray, gaps: np.ndarray) -> np.ndarray:
    """Values (samples,) with a straight line in place of those where `gaps` is true; missing ones elsewhere stay."""
    index, right = np.arange(len(values)), ~gaps & np.isfinite(values)
    if not gaps.any() or not right.any():
        return values
    return np.where(gaps, np.interp(index, index[right], values[right]), values)


def _largest_probability(probabilities: Sequence[float], count: int) -> float:
    """The largest probability under noise alone, of so many samples, that counts as wrong; below 0 if there is none."""
    ordered = np.sort(probabilities)
    below = ordered <= MAX_FALSE_SHARE * np.arange(1, len(ordered) + 1) / max(count, 1)
    return float(ordered[np.flatnonzero(below)[-1]]) if below.any() else -1.0


def _suspects(record: Record, test: GapTest) -> GapDeviations:
    """The suspect places of a record without those that other cycles or the model have too."""
    found, peaks = test.suspects(record.values), test.peaks(record.values)
    elsewhere, repeats = _at_other_cycles(record, peaks, found.first)
    if record.model is not None and len(found.first):
        reach = 2 * round(MODEL_TOLERANCE / record.interval) + 1
        modelled = maximum_filter1d(np.abs(test.peaks(record.model)), reach)
        elsewhere = np.maximum(elsewhere, modelled[found.first])
    kept = np.abs(found.peak) > MIN_EXCESS * elsewhere
    if test.gap > 1:  # a short bend of the signal looks the same, and only other cycles tell
        kept &= repeats
    return GapDeviations(*(column[kept] for column in found))


def _at_other_cycles(record: Record, peaks: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What half of the other cycles reach there, in the direction of each peak, and whether the cycles repeat there."""
    n, reached, repeats = len(peaks), np.zeros(len(places)), np.zeros(len(places), bool)
    if record.period is None:
        return reached, repeats
    per_cycle, nearby = record.period / record.interval, np.arange(-PHASE_TOLERANCE, PHASE_TOLERANCE + 1)
    for k, place in enumerate(places):
        first, last = math.ceil(-place / per_cycle), math.floor((n - 1 - place) / per_cycle)
        cycles = np.array([c for c in range(first, last + 1) if c])
        if len(cycles):
            at = np.clip(np.round(place + cycles * per_cycle).astype(int)[:, None] + nearby, 0, n - 1)
            reached[k] = max(0.0, np.median(np.max(np.sign(peaks[place]) * peaks[at], axis=1)))
            repeats[k] = place >= record.settled
    return reached, repeats
