"""Find samples that are in a campaign twice: a run under two names, windows that overlap, two signals of one column.

Noise never repeats a sequence of samples to the last digit. A copy counts as a second measurement, so that standard
errors become too small, and a held-out copy of a fitted run agrees with any model that fits.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from edhas_jax.core.remark import Remark
from edhas_jax.measurements.campaign import BenchRun, Use

SEQUENCE = 24  # equal samples in a row; ten of a quiet 12-bit recorder repeat by chance in a long record
MIN_COPIED_SHARE = 0.05  # of the shorter record; less may be a few samples of a signal that moves without noise
MIN_MOVING_SHARE = 0.5  # of the samples of a sequence that differ from the one before: a resting signal is no copy
MOST_SEQUENCES = 500_000  # of a campaign that are compared; sorting more would take longer than reading them
MULTIPLIER = np.uint64(0x9E3779B97F4A7C15)  # odd, 2⁶⁴ over the golden ratio: spreads near numbers over all bits


def check_copies(runs: Sequence[BenchRun]) -> Iterator[Remark]:
    """Find the records that hold the same samples.

    Args:
        runs: the measured runs.

    Yields:
        A warning on each signal of a run that equals another one of it, and on each run that shares samples with
        another in all signals that move in either.
    """
    signals = {(r, name): values for r, run in enumerate(runs) for name, values in run.signals.items()}
    kept = max(1, sum(map(len, signals.values())) // MOST_SEQUENCES)
    marks = {place: _sequence_marks(values, kept) for place, values in signals.items()}
    for r, run in enumerate(runs):
        names = list(run.signals)
        for one, other in _shares([marks[r, name] for name in names]):
            sentence = f"{names[one]} and {names[other]} hold the same samples"
            yield run.warning(f"{sentence}; does one of them name the wrong column?", 0)
    shares: dict[tuple[int, int], dict[str, float]] = {}
    for name in dict.fromkeys(name for run in runs for name in run.signals):
        owners = [r for r, run in enumerate(runs) if name in run.signals]
        for (one, other), share in _shares([marks[r, name] for r in owners]).items():
            shares.setdefault((owners[one], owners[other]), {})[name] = share
    for (one, other), found in sorted(shares.items()):
        common = set(runs[one].signals) & set(runs[other].signals)
        if all(name in found for name in common if len(marks[one, name]) or len(marks[other, name])):
            yield runs[other].warning(_copy_text(runs[one], runs[other], min(found.values())))


def _copy_text(one: BenchRun, other: BenchRun, share: float) -> str:
    """What is wrong with a run of which a share of the samples is in an earlier one too."""
    samples = "all samples" if share > 0.99 else f"{100 * share:.0f} % of the samples"
    harm = "they count twice, so that standard errors are too small"
    if one.use is not other.use:
        harm = "what is held out was fitted too, and tests nothing"
    elif one.use is Use.HOLDOUT:
        harm = "they are judged twice"
    return f"{samples} are those of {one.name} to the last digit; {harm}"


def _shares(marks: Sequence[np.ndarray]) -> dict[tuple[int, int], float]:
    """The pairs of records with common sequences, by their places, and the share of the shorter one that is common."""
    joined = np.concatenate([*marks, np.zeros(0, np.uint64)])
    order = np.argsort(joined, kind="stable")
    owner = np.repeat(np.arange(len(marks)), [len(of_one) for of_one in marks])[order]
    equal = np.flatnonzero(joined[order][1:] == joined[order][:-1])
    pairs, counts = np.unique(np.stack([owner[equal], owner[equal + 1]]), axis=1, return_counts=True)
    shares = {
        (int(one), int(other)): count / min(len(marks[one]), len(marks[other]))
        for (one, other), count in zip(pairs.T, counts, strict=True)
    }
    return {pair: share for pair, share in shares.items() if share > MIN_COPIED_SHARE}


def _sequence_marks(values: np.ndarray, kept: int) -> np.ndarray:
    """A number (k,) for each different sequence of samples that moves; equal sequences have equal numbers.

    Of `kept` sequences one is taken, by its number, so that it is taken in each record that has it.
    """
    count = len(values) - SEQUENCE + 1
    if count < 1:
        return np.zeros(0, np.uint64)
    with np.errstate(over="ignore", invalid="ignore"):  # arithmetic modulo 2⁶⁴ is meant
        bits = (values + 0.0).view(np.uint64) * MULTIPLIER  # + 0: there is one zero
        bits ^= bits >> np.uint64(29)
        marks = np.zeros(count, np.uint64)
        for k in range(SEQUENCE):
            marks = marks * MULTIPLIER + bits[k : count + k]
        moves = np.diff(values) != 0.0
    moving = np.convolve(moves, np.ones(SEQUENCE - 1), "valid") >= MIN_MOVING_SHARE * (SEQUENCE - 1)
    missing = np.convolve(~np.isfinite(values), np.ones(SEQUENCE), "valid") > 0.5
    marks = marks[moving & ~missing]
    return np.unique(marks[(marks >> np.uint64(32)) % np.uint64(kept) == 0])
