"""Thinning of long records for a plot: the smallest and the largest sample of each small interval remain."""

import numpy as np


def thinned(time: np.ndarray, values: np.ndarray, first: float, last: float, width: int) -> np.ndarray:
    """Indices of the samples that a plot needs so that it looks as with all of them.

    Args:
        time: increasing times of the samples (samples,) [s].
        values: the samples (samples,); NaN where one is missing.
        first: first time that is shown [s].
        last: last time that is shown [s].
        width: intervals into which the plot is divided; one for each pixel is enough.

    Returns:
        Increasing indices, at most 2 · `width` and a sample beyond either end.
    """
    begin = max(int(np.searchsorted(time, first)) - 1, 0)
    end = min(int(np.searchsorted(time, last, side="right")) + 1, len(time))
    count = end - begin
    if count <= 2 * width:
        return np.arange(begin, end)
    size = -(-count // width)
    whole = count // size
    block = values[begin : begin + whole * size].reshape(whole, size)
    low = np.argmin(np.where(np.isnan(block), np.inf, block), axis=1)
    high = np.argmax(np.where(np.isnan(block), -np.inf, block), axis=1)
    starts = begin + size * np.arange(whole)
    rest = np.arange(begin + whole * size, end)
    ends = np.array([begin, end - 1])
    return np.unique(np.concatenate([starts + low, starts + high, ends, rest[:1], rest[-1:]]))
