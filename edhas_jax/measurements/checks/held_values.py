"""Find short drop-outs at which a recorder repeats its last value, or writes zeros."""

import numpy as np

from edhas_jax.measurements.checks.signal_checks import MIN_STUCK_SAMPLES, true_intervals

MIN_NOISE_OVER_RESOLUTION = 1.0  # with less noise a live sensor repeats its value too
MIN_EQUAL = 3  # successive equal samples
MAX_CHANCE = 1e-3  # expected number of such repetitions of a live sensor in the record
# share of the samples of a record with drop-outs that single repetitions may have, to be left out without being certain
MAX_UNCERTAIN_SHARE = 0.01


def find_held_values(values: np.ndarray, noise: float, resolution: float) -> np.ndarray:
    """Find the samples of a record that repeat the one before, where a live sensor would not.

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
    equal = [(first, last + 1) for first, last in true_intervals(np.diff(values) == 0.0)]
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
