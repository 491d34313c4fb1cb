"""Find samples of equal value: a stuck sensor, one at an end of its range, a recorder that repeats its last value."""

import numpy as np

MIN_STUCK_SAMPLES = 10  # equal samples in a row from which a sensor counts as stuck
MIN_CLIPPING_RATIO = 5  # occurrences of the extreme value of a clipped signal over those of any other value
MIN_NOISE_OVER_RESOLUTION = 1.0  # with less noise a live sensor repeats its value too
MIN_EQUAL = 3  # successive equal samples
MAX_CHANCE = 1e-3  # expected number of such repetitions of a live sensor in the record
# share of the samples of a record with drop-outs that single repetitions may have, to be left out without being certain
MAX_UNCERTAIN_SHARE = 0.01


def true_intervals(mask: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every interval of consecutive true entries of a mask (samples,)."""
    edges = np.diff(np.concatenate([[0], mask.astype(int), [0]]))
    return list(zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1, strict=True))


def _constant_intervals(values: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every interval of equal samples."""
    return [(first, last + 1) for first, last in true_intervals(np.diff(values) == 0.0)]


def stuck_intervals(values: np.ndarray) -> list[tuple[int, int]]:
    """Intervals of equal samples that are too long for a sensor whose last digit moves with its noise."""
    steps = np.abs(np.diff(values))
    steps = steps[np.isfinite(steps)]
    long = [(first, last) for first, last in _constant_intervals(values) if last - first + 1 >= MIN_STUCK_SAMPLES]
    inside = sum(last - first for first, last in long)
    # where many other steps are zero too, the last digit is coarser than the noise: constant intervals are normal
    if np.sum(steps == 0.0) - inside > 0.2 * max(len(steps) - inside, 1):
        return []
    return long


def is_clipped_at(values: np.ndarray, extreme: float) -> bool:
    """Whether a signal returns to exactly its extreme value far more often than to any other value."""
    if len(true_intervals(values == extreme)) < 2:
        return False
    moving = np.isfinite(values)
    for first, last in _constant_intervals(values):
        moving[first : last + 1] &= values[first] == extreme or last - first + 1 < MIN_STUCK_SAMPLES
    found, counts = np.unique(values[moving], return_counts=True)
    others = counts[found != extreme]
    occurs = (found == extreme).any()
    return bool(occurs) and counts[found == extreme][0] >= MIN_CLIPPING_RATIO * max(others.max(initial=1), 1)


def find_held_values(values: np.ndarray, noise: float, resolution: float) -> np.ndarray:
    """Find the samples of short drop-outs, which repeat the one before where a live sensor would not.

    Args:
        values: a signal (samples,).
        noise: standard deviation of its noise.
        resolution: step of the recorder, in the same unit; 0 if it is too fine to be seen.

    Returns:
        A mask (samples,) of the repetitions, of zeros with the first one. Extreme values, which may be a limit, and
        repetitions as long as those of a stuck sensor, are not among them. In a record with such repetitions, values
        that occur twice in a row count too, because a recorder that repeats values also repeats some only once.
    """
    found = np.zeros(len(values), bool)
    if not np.isfinite(values).any() or noise < MIN_NOISE_OVER_RESOLUTION * resolution:
        return found
    equal = _constant_intervals(values)
    pairs = sum(last - first + 1 < MIN_EQUAL for first, last in equal)
    chance_of_a_pair = (pairs + 1.0) / len(values)
    limits = (np.nanmin(values), np.nanmax(values))
    uncertain = np.zeros(len(values), bool)
    for first, last in equal:
        length = last - first + 1
        is_chance = length < MIN_EQUAL or len(values) * chance_of_a_pair ** (length - 1) > MAX_CHANCE
        at_an_end = first == 0 or last == len(values) - 1
        if not (at_an_end or length >= MIN_STUCK_SAMPLES or values[first] in limits):
            mask = uncertain if is_chance else found
            mask[first if values[first] == 0.0 else first + 1 : last + 1] = True
    return found | uncertain if found.any() and uncertain.sum() < MAX_UNCERTAIN_SHARE * len(values) else found
