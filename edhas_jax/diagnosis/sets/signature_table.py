"""What every cause would change in the measurements: signatures of all candidates, and slopes of all free terms.

All of them are simulated once, at one fit, and whitened; see `linear_model` for what is made of them. The background is
what free curves at all places together can do: the directions of their smoothest shapes, each of unit length.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.least_squares import OVERFLOW_LIMIT
from edhas_jax.diagnosis.laws.curve_prior import CurvePrior
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.free_curves import curves_with_slopes
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.search.memory_term import memories_with_slopes
from edhas_jax.diagnosis.search.screening import ScoreTest, Signatures

SHAPES = 4  # of each curve in the background: its four smoothest shapes, about a cubic
SMOOTHNESS = 0.3  # size of the bends over that of the values of these curves
MAX_DIRECTIONS, MIN_EIGENVALUE = 100, 1e-4  # of the background: their number, and the smallest one over the largest


@dataclasses.dataclass(frozen=True)
class FreeSlopes:
    """A free term, and its rows (k, m): the change by a prior standard deviation of each of its k numbers, whitened."""

    term: FreeTerm
    rows: np.ndarray
    gram: np.ndarray


@dataclasses.dataclass(frozen=True)
class SignatureTable:
    """The signatures of all causes at one fit.

    Args:
        candidates: effects and sensor faults with their signatures, rows (k, m) of one matrix each.
        free: the free terms: curves, memories and resonances.
        background: directions (m, g) of the background, whitened.
        ends: where the signals end among the m samples.
        rows: the rows of all candidates, then those of all free terms, of which theirs are views.
    """

    candidates: tuple[Signatures, ...]
    free: tuple[FreeSlopes, ...]
    background: np.ndarray
    ends: np.ndarray
    rows: np.ndarray


def signature_table(fit: Fit, candidates: Sequence[Candidate], report: Callable[[str], None]) -> SignatureTable:
    """Simulate the signatures of all causes at a fit.

    Args:
        fit: the fit of a model without any of them.
        candidates: effects and sensor faults.
        report: called with a sentence on the progress.
    """
    test = ScoreTest(fit, ())
    report("signatures of all effects and sensor faults")
    named = tuple(found for candidate in candidates if len((found := test.signatures(candidate)).rows))
    found = []
    for term, slopes in (*curves_with_slopes(fit, report), *memories_with_slopes(fit, report)):
        rows = test.whitened([{n: term.spread * v for n, v in run.items()} for run in slopes]).T
        if (np.abs(rows) < OVERFLOW_LIMIT).all() and np.abs(rows).max() > 0.0:
            found.append(FreeSlopes(term, rows.astype(np.float32), rows @ rows.T))
    samples = int(test.ends[-1])
    every = np.concatenate([np.zeros((0, samples), np.float32), *(of.rows for of in (*named, *found))])
    views = iter(np.split(every, np.cumsum([len(of.rows) for of in (*named, *found)])))
    named = tuple(dataclasses.replace(of, rows=next(views)) for of in named)
    found = tuple(dataclasses.replace(of, rows=next(views)) for of in found)
    return SignatureTable(named, found, _background(found, samples), test.ends, every)


def _background(free: Sequence[FreeSlopes], samples: int) -> np.ndarray:
    """The directions of the background (m, g), whitened."""
    shapes = []
    for of in free:
        if not isinstance(of.term, CurveCandidate):
            continue
        vectors, sizes, _ = np.linalg.svd(CurvePrior(1.0, SMOOTHNESS).factor(np.array(of.term.nodes)))
        columns = of.rows.T @ (vectors[:, :SHAPES] * sizes[:SHAPES])
        lengths = np.linalg.norm(columns, axis=0)
        shapes.append(columns[:, lengths > 0.0] / lengths[lengths > 0.0])
    if not shapes:  # a rig of one's own without slots
        return np.zeros((samples, 0))
    stack = np.concatenate(shapes, axis=1)
    values, vectors = np.linalg.eigh(stack.T @ stack)
    kept = np.argsort(-values)[:MAX_DIRECTIONS]
    return stack @ vectors[:, kept[values[kept] > MIN_EIGENVALUE * values.max()]]
