"""Test whether a few successive samples deviate from a polynomial through their neighbours by more than noise does."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.special import chdtrc

from edhas_jax.measurements.checks.noise_correlation import autocorrelation_of

DEGREE = 3  # of the polynomial
MIN_LINE_DEVIATION = 3.0  # standard deviations of every sample from the straight line between the two next to the gap
MAX_NEIGHBOUR_SQUARE = 3.3  # mean square of the neighbours' residual over that of noise; one in a thousand exceeds it
SCALE_WINDOWS, SHARE_OF_SCALE = np.arange(-32, 33, 4), 0.5  # windows around whose median residual counts, by this share


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
