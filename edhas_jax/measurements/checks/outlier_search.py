"""Find wrong samples of a record: those that jump away from their neighbours and back.

Large excursions (`find_excursions`) leave and return within one sample: the straight lines through the two samples
before and after them miss their ends by far more than anything around bends. A peak of several samples that rises and
falls step by step is no such excursion, however high. One of more than three samples is wrong only where the recorder
has written one value, to the last digit, in place of a moving one, or where it zigzags as no other cycle does.

Moderate ones, a few standard deviations of the noise, are tested where the signal is smooth, so that its neighbours
predict a sample. How many samples are called wrong is decided for all of a signal together: the expected share of
mistakes among them is limited.

A sharp event of the machine, such as a valve that closes, disturbs the neighbours too, or repeats at the same phase of
other cycles, or occurs in the model at about that time. The model only acquits: no sample is wrong because it is far
from the model.

Source: Benjamini, Hochberg, Controlling the false discovery rate, J. R. Stat. Soc. B 57 (1995).
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import maximum_filter1d
from scipy.special import chdtrc

from edhas_jax.measurements.checks.noise_correlation import autocorrelation_of

GAPS = (1, 2, 3)  # successive samples that are tested together
NEIGHBOURS = 6  # samples on either side that predict a signal
MIN_EXCESS = 2.5  # of a wrong sample's deviation over that at the same phase of other cycles, and over the model's
PHASE_TOLERANCE = 3  # samples by which an event may move from cycle to cycle
MODEL_TOLERANCE = 2e-3  # s by which an event of the model may come earlier or later
MAX_FALSE_SHARE = 1e-3  # expected share of mistakes
MAX_EXCURSION, MAX_SMOOTH = 20, 3  # samples of an excursion, and of one that neither zigzags nor is a constant
MIN_JUMP, MIN_JUMP_WITHOUT_CYCLES = 8.0, 25.0  # standard deviations of the noise, at both ends of an excursion
MIN_JUMP_OF_HEIGHT = 0.8  # share of the height of an excursion that its jumps have: a peak rises step by step
MAX_DISPLACEMENT = 0.5  # of the signal from before to after an excursion, over its jumps: more is a step
MIN_ZIGZAG = 1.2  # mean bend within a burst over its mean height; 2.4 of random values, at most 1 of a peak
# bends on either side with which jumps are compared: all of the next two, and of the others the largest but three, so
# that another spike, which makes three, hides none
NEAR, REACH, OTHERS = 2, 12, 3
MAX_EXCURSIONS = 0.02  # share of the samples; more are no exceptions
LENGTHS = (*range(1, MAX_EXCURSION + 1), 1, 2, 3)  # in turn; the last are the flanks of what was found before
DEGREE = 3  # of the polynomial through the neighbours of successive samples
MIN_LINE_DEVIATION = 3.0  # standard deviations of every sample from the straight line between the two next to the gap
MAX_NEIGHBOUR_SQUARE = 3.3  # mean square of the neighbours' residual over that of noise; one in a thousand exceeds it
SCALE_WINDOWS, SHARE_OF_SCALE = np.arange(-32, 33, 4), 0.5  # windows around whose median residual counts, by this share


class Record(NamedTuple):
    """Samples of one run on an even grid: values and model (samples,), sample interval and length of a cycle [s].

    `model` is None where there is none, `period` for a run without cycles. The cycles repeat from sample `settled` on.
    """

    values: np.ndarray
    model: np.ndarray | None
    interval: float
    period: float | None
    settled: int


class GapDeviations(NamedTuple):
    """Suspect samples of a record.

    `first` are the indices of the first sample of each gap, `peak` the largest deviation in it with its sign,
    `probability` that of the deviations under noise alone.
    """

    first: np.ndarray
    peak: np.ndarray
    probability: np.ndarray


class GapTest:
    """The test of a number of successive samples between their neighbours.

    Args:
        gap: the number of samples.
        neighbours: the number of samples on either side.
        noise: standard deviation of the noise (SI).
        correlation: autoregressive coefficients of the noise.
    """

    def __init__(self, gap: int, neighbours: int, noise: float, correlation: Sequence[float]):
        self.gap, self._neighbours, self._noise, self._length = gap, neighbours, noise, 2 * neighbours + gap
        inside = np.zeros(self._length, bool)
        inside[neighbours : neighbours + gap] = True
        powers = np.vander(np.linspace(-1.0, 1.0, self._length), DEGREE + 1)
        from_neighbours = np.linalg.lstsq(powers[~inside], np.eye(2 * neighbours), rcond=None)[0]
        unit = np.eye(self._length)
        self._deviation, self._line, self._residual = unit[inside], unit[inside], unit[~inside]
        self._deviation[:, ~inside] -= powers[inside] @ from_neighbours
        self._residual[:, ~inside] -= powers[~inside] @ from_neighbours
        share = np.arange(1, gap + 1) / (gap + 1.0)
        self._line[:, neighbours - 1] -= 1.0 - share
        self._line[:, neighbours + gap] -= share
        lags = np.abs(np.subtract.outer(np.arange(self._length), np.arange(self._length)))
        covariance = autocorrelation_of(correlation, self._length)[lags]
        spread = self._deviation @ covariance @ self._deviation.T
        self._weight = np.linalg.lstsq(spread, np.eye(len(spread)), rcond=None)[0]
        self._freedom = float(np.trace(self._residual @ covariance @ self._residual.T))

    def peaks(self, values: np.ndarray) -> np.ndarray:
        """The largest deviation of the samples from each one on (samples,), with its sign; 0 where it is not known."""
        found = np.zeros(len(values))
        if len(values) >= self._length:
            deviation = _along(values, self._deviation)
            peak = np.take_along_axis(deviation, np.argmax(np.abs(deviation), axis=1)[:, None], axis=1)[:, 0]
            found[self._neighbours : self._neighbours + len(peak)] = np.nan_to_num(peak)
        return found

    def suspects(self, values: np.ndarray) -> GapDeviations:
        """The places of a record (samples,), NaN where a sample is missing, where noise alone is improbable."""
        if len(values) < self._length:
            return GapDeviations(np.zeros(0, int), np.zeros(0), np.zeros(0))
        windows, peaks = sliding_window_view(values, self._length), self.peaks(values)[self._neighbours :]
        # a bend of the signal deviates from the polynomial, but hardly from the straight line between its neighbours
        line = _along(values, self._line) * np.sign(peaks[: len(windows), None])
        at = np.flatnonzero((line > MIN_LINE_DEVIATION * self._noise).all(axis=1))
        square = self._square(windows[at])
        at, square = at[square < MAX_NEIGHBOUR_SQUARE], square[square < MAX_NEIGHBOUR_SQUARE]
        around = np.clip(at[:, None] + SCALE_WINDOWS, 0, len(windows) - 1)
        scale = np.array([np.nanmedian(self._square(windows[rows])) for rows in around])
        deviation = windows[at] @ self._deviation.T
        statistic = np.einsum("wi,ij,wj->w", deviation, self._weight, deviation) / self._noise**2
        statistic /= np.maximum(np.maximum(square, SHARE_OF_SCALE * scale), 1.0)
        return GapDeviations(at + self._neighbours, peaks[at], chdtrc(self.gap, statistic))

    def _square(self, windows: np.ndarray) -> np.ndarray:
        """Mean square of the neighbours' residual over that of noise (windows,)."""
        return np.sum((windows @ self._residual.T) ** 2, axis=1) / self._freedom / self._noise**2


def _along(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """The products of all windows of a record with some rows (windows, rows)."""
    return np.stack([np.correlate(values, row, "valid") for row in rows], axis=1)


def find_outliers(
    records: Sequence[Record], noise: float, correlation: Sequence[float], with_excursions: bool = True
) -> list[np.ndarray]:
    """Find the wrong samples of a signal in all its runs.

    Args:
        records: the runs; missing samples are NaN.
        noise: standard deviation of the noise (SI).
        correlation: autoregressive coefficients of the noise.
        with_excursions: whether large excursions are looked for first.

    Returns:
        A mask (samples,) for each record.
    """
    found = [find_excursions(r, noise) if with_excursions else np.zeros(len(r.values), bool) for r in records]
    for gap in GAPS:
        test = GapTest(gap, NEIGHBOURS, noise, correlation)
        # a straight line in place of the samples that are known to be wrong
        mended = [r._replace(values=bridged(r.values, mask)) for r, mask in zip(records, found, strict=True)]
        rows = [_suspects(record, test) for record in mended]
        limit = _largest_probability([p for row in rows for p in row.probability], sum(map(len, found)))
        for mask, row in zip(found, rows, strict=True):
            for first in row.first[row.probability <= limit]:
                mask[first : first + gap] = True
    return found


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


def find_excursions(record: Record, noise: float) -> np.ndarray:
    """Find the samples of a record that belong to spikes and drop-outs.

    Args:
        record: the run; missing samples are NaN.
        noise: standard deviation of the noise (SI).

    Returns:
        A mask (samples,).
    """
    found, missing = np.zeros(len(record.values), bool), ~np.isfinite(record.values)
    if (~missing).sum() < 2 * (REACH + MAX_EXCURSION):
        return found
    for length in LENGTHS:
        # missing samples and those already found are bridged, so that they neither hide nor cause an excursion
        found |= _excursions(record._replace(values=bridged(record.values, found | missing)), noise, length)
    found &= ~missing
    return found if found.sum() <= max(MAX_EXCURSION, MAX_EXCURSIONS * len(found)) else np.zeros(len(found), bool)


def _excursions(record: Record, noise: float, length: int) -> np.ndarray:
    """A mask (samples,) of the excursions of so many samples that are far from everything around them."""
    values, found = record.values, np.zeros(len(record.values), bool)
    bends = _bends(values)
    first = np.arange(2, len(values) - length - 1)  # the samples on either side: first − 1, first + length
    jump = np.minimum(np.abs(bends[first - 1]), np.abs(bends[first + length]))
    first, jump = first[jump > MIN_JUMP * noise], jump[jump > MIN_JUMP * noise]
    around = _largest_around(np.abs(bends), first, first + length)
    if record.model is not None:
        reach = 2 * (MAX_EXCURSION + round(MODEL_TOLERANCE / record.interval)) + 1
        around = np.maximum(around, maximum_filter1d(np.abs(_bends(record.model)), reach)[first])
    for place, size in zip(first[jump > MIN_EXCESS * around], jump[jump > MIN_EXCESS * around], strict=True):
        inside, ends = slice(place, place + length), values[[place - 1, place + length]]
        height = np.abs(values[inside] - np.interp(np.arange(1, length + 1), [0, length + 1], ends))
        (reached,), (repeats,) = _at_other_cycles(record, bends, np.array([place - 1]))
        if size < max(MIN_EXCESS * reached, (MIN_JUMP if repeats else MIN_JUMP_WITHOUT_CYCLES) * noise):
            continue
        is_away, displacement = np.min(height) > 0.5 * size, abs(ends[1] - ends[0])
        if length <= MAX_SMOOTH:
            returns = displacement < MAX_DISPLACEMENT * size
            is_wrong = is_away and returns and size > MIN_JUMP_OF_HEIGHT * np.max(height)
        else:
            is_wrong = is_away and np.ptp(values[inside]) == 0.0 and _moves(values, place, place + length)
        # a step is as steep, but far from returning
        zigzags = np.mean(np.abs(bends[inside])) > max(MIN_ZIGZAG * np.mean(height), displacement)
        found[inside] |= is_wrong or (length > 1 and zigzags and repeats)
    return found


def _bends(values: np.ndarray) -> np.ndarray:
    """The change of slope at each sample (samples,); 0 at the ends."""
    return np.concatenate([[0.0], np.diff(values, 2), [0.0]])


def _largest_around(bends: np.ndarray, first: np.ndarray, end: np.ndarray) -> np.ndarray:
    """The bend that counts around excursions from samples `first` up to `end`, their neighbours not included."""
    padded = np.pad(bends, REACH, mode="reflect")
    sides = padded[first[:, None] - 1 + np.arange(REACH)], padded[end[:, None] + REACH + 1 + np.arange(REACH)]
    near = sides[0][:, REACH - NEAR :].max(axis=1), sides[1][:, :NEAR].max(axis=1)
    others = [np.partition(side, REACH - 1 - OTHERS, axis=1)[:, REACH - 1 - OTHERS] for side in sides]
    return np.max([*near, *others], axis=0)


def _moves(values: np.ndarray, first: int, end: int) -> bool:
    """Whether most samples around some differ from the next one."""
    steps = np.append(np.diff(values[max(0, first - REACH) : first]), np.diff(values[end : end + REACH]))
    return bool(np.count_nonzero(steps) > 0.5 * len(steps))
