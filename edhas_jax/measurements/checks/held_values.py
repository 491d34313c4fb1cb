"""Find short drop-outs at which a recorder repeats its last value, or writes zeros."""

import math

import numpy as np

from edhas_jax.measurements.checks.signal_checks import MIN_STUCK_SAMPLES, true_intervals

MIN_EQUAL = 3  # successive equal samples
MIN_CHANCE_OF_A_PAIR = 0.01  # of a live sensor whose resolution is too fine to be seen, where its signal rests
MAX_CHANCE = 1e-3  # expected number of such repetitions of a live sensor in the record
PEAK_OF_NORMAL_DENSITY = 1.0 / math.sqrt(2.0 * math.pi)


def find_held_values(values: np.ndarray, innovation: float, resolution: float) -> np.ndarray:
    """Find the samples of a record that repeat the one before, where a live sensor would not.

    Args:
        values: a signal (samples,).
        innovation: standard deviation of what the sample before does not predict of its noise.
        resolution: step of the recorder, in the same unit; 0 if it is too fine to be seen.

    Returns:
        A mask (samples,) of the repetitions, of zeros with the first one. Extreme values, which may be a limit, and
        repetitions as long as those of a stuck sensor, are not among them.
    """
    found = np.zeros(len(values), bool)
    equal = [(first, last + 1) for first, last in true_intervals(np.diff(values) == 0.0)]
    if not equal or not innovation > 0.0:
        return found
    pairs = sum(last - first + 1 < MIN_EQUAL for first, last in equal)
    from_noise = PEAK_OF_NORMAL_DENSITY * resolution / innovation
    chance_of_a_pair = max(pairs / len(values), from_noise, MIN_CHANCE_OF_A_PAIR)
    limits = (np.nanmin(values), np.nanmax(values))
    for first, last in equal:
        length = last - first + 1
        is_chance = length < MIN_EQUAL or len(values) * chance_of_a_pair ** (length - 1) > MAX_CHANCE
        at_an_end = first == 0 or last == len(values) - 1
        if not (is_chance or at_an_end or length >= MIN_STUCK_SAMPLES or values[first] in limits):
            found[first if values[first] == 0.0 else first + 1 : last + 1] = True
    return found
