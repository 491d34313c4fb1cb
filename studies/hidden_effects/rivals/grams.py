"""Scalar products of residual, sensitivities and signatures in each run: all that linear methods need.

With r the residual, L the sensitivities of the coordinates (uncertain parameters and errors of the bench) and S the
signatures of all suspects at all points of their grids, G is the matrix of scalar products of [r, L, S] over the
samples of a run. Any least-squares fit to some runs, and its error on others, follows from the G of the runs.
"""

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import nnls

from studies.hidden_effects.signatures import SignatureTable

RIDGE = 1e-9  # of the mean square of the signatures, for those that are nearly parallel


@dataclasses.dataclass(frozen=True)
class Grams:
    """Scalar products of [r, L, S] by run and signal.

    Args:
        blocks: of the samples of each run and signal (runs, signals, 1 + p + k, 1 + p + k).
        counts: number of these samples (runs, signals).
        prior: of the rows of the prior, in which L is the identity and r the negative coordinates.
        coordinates: the number p of coordinates.
        names: the suspects.
        columns: for each of them the indices of its signatures in S.
    """

    blocks: np.ndarray
    counts: np.ndarray
    prior: np.ndarray
    coordinates: int
    names: tuple[str, ...]
    columns: tuple[np.ndarray, ...]

    @functools.cached_property
    def by_run(self) -> np.ndarray:
        """The scalar products of each run (runs, …)."""
        return self.blocks.sum(axis=1)

    def fitted_to(self, runs: Sequence[int]) -> "LinearFit":
        """The least-squares problem of some runs."""
        return LinearFit(self, self.by_run[list(runs)].sum(axis=0) + self.prior)


@dataclasses.dataclass(frozen=True)
class LinearFit:
    """Least squares over some runs: coordinates free within their priors, signatures with weights of at least 0.

    Args:
        grams: the scalar products.
        gram: those of the runs of the fit and of the prior.
    """

    grams: Grams
    gram: np.ndarray

    @functools.cached_property
    def _compensation(self) -> np.ndarray:
        """The coordinates (p, 1 + k) that compensate the residual and each signature."""
        middle = slice(1, 1 + self.grams.coordinates)
        others = np.r_[0, 1 + self.grams.coordinates : len(self.gram)]
        return cho_solve(cho_factor(self.gram[middle, middle]), self.gram[middle][:, others])

    @functools.cached_property
    def projected(self) -> np.ndarray:
        """The scalar products (1 + k, 1 + k) of residual and signatures less what the coordinates reproduce."""
        middle = slice(1, 1 + self.grams.coordinates)
        others = np.r_[0, 1 + self.grams.coordinates : len(self.gram)]
        return self.gram[np.ix_(others, others)] - self.gram[middle][:, others].T @ self._compensation

    def falls(self) -> np.ndarray:
        """The fall of χ² by each signature alone (k,), its weight at least 0."""
        overlaps, squares = self.projected[0, 1:], np.diag(self.projected)[1:]
        usable = squares > RIDGE * squares.mean()
        return np.square(np.maximum(np.divide(overlaps, squares**0.5, out=np.zeros_like(squares), where=usable), 0.0))

    def weights(self, columns: np.ndarray) -> tuple[np.ndarray, float]:
        """The weights of some signatures, each at least 0, and the fall of χ² that they achieve."""
        a, b = self.projected[np.ix_(1 + columns, 1 + columns)], self.projected[0, 1 + columns]
        scale = np.sqrt(np.diag(a))
        a, b = a / np.outer(scale, scale), b / scale
        factor = np.linalg.cholesky(a + 1e-7 * np.eye(len(a)))
        found, _ = nnls(factor.T, np.linalg.solve(factor, b))
        return found / scale, float(2.0 * b @ found - found @ a @ found)

    def error_on(self, run: int, columns: np.ndarray, weights: np.ndarray) -> float:
        """The sum of squares that the fit leaves of the signals of a run."""
        whole = np.zeros(len(self.gram))
        whole[0] = 1.0
        whole[1 + self.grams.coordinates + columns] = -weights
        others = np.r_[0, 1 + self.grams.coordinates : len(self.gram)]
        whole[1 : 1 + self.grams.coordinates] = -self._compensation @ whole[others]
        return float(whole @ self.grams.by_run[run] @ whole)


def grams_of(table: SignatureTable) -> Grams:
    """The scalar products of a table of signatures."""
    rows = [suspect.rows for suspect in table.suspects]
    whole = np.concatenate([table.residual[:, None], table.slopes, *(of.T for of in rows)], axis=1)
    runs, signals = range(len(table.run_names)), range(len(table.signal_names))
    chosen = [[whole[(table.run == r) & (table.signal == s)] for s in signals] for r in runs]
    p = len(table.x)
    prior = np.zeros((p, whole.shape[1]))
    prior[:, 0] = -1.0 * table.has_prior * table.x
    prior[:, 1 : 1 + p] = np.diag(table.has_prior.astype(float))
    ends = np.cumsum([0, *map(len, rows)])
    return Grams(
        np.array([[part.T @ part for part in of] for of in chosen]),
        np.array([[len(part) for part in of] for of in chosen]),
        prior.T @ prior, p, tuple(s.name for s in table.suspects),
        tuple(np.arange(a, b) for a, b in zip(ends, ends[1:], strict=False)),
    )  # fmt: skip
