"""Find the resolution of a recorder: the step of which the differences of all values of a signal are multiples."""

from collections.abc import Iterable

import numpy as np

MIN_VALUES = 8  # different values of a record; fewer do not show a regular step
SMALLEST_GAPS = 0.5  # share of the gaps between neighbouring values, the smallest, that are mostly one step
MAX_MISS = 0.1  # of a value from a whole number of steps, in steps
MIN_SHARE_ON_STEPS = 0.95  # of the values


def recorder_resolution(records: Iterable[np.ndarray]) -> float:
    """The step between neighbouring values of a recorder.

    Args:
        records: the values of a signal (samples,) in each run (SI).

    Returns:
        The largest step of any run (SI); 0 if the values are continuous, or the step is too fine to be seen.
    """
    return max((_step(values[np.isfinite(values)]) for values in records), default=0.0)


def _step(values: np.ndarray) -> float:
    levels = np.unique(values)
    if len(levels) < MIN_VALUES:
        return 0.0
    gaps = np.diff(levels)
    step = float(np.median(np.sort(gaps)[: max(1, int(SMALLEST_GAPS * len(gaps)))]))
    # from gap to gap first: over the whole range the error of one gap would add up
    steps, used = np.concatenate([[0.0], np.cumsum(np.round(gaps / step))]), np.ones(len(levels), bool)
    for _ in range(2):
        if np.ptp(steps[used]) == 0.0:
            return 0.0
        step, first = (float(c) for c in np.polyfit(steps[used], levels[used], 1))
        if not step > 0.0:
            return 0.0
        steps = np.round((levels - first) / step)
        misses = np.abs((levels - first) / step - steps)
        used = misses < MAX_MISS
        if used.mean() < MIN_SHARE_ON_STEPS:
            return 0.0
    return step
