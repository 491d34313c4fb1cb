"""Projected score test: which candidates could explain the residual of a calibrated model.

The signature s of a candidate is the change of the signals when it is added at a finite size. With r the residual and J
the sensitivity of the signals to the unknowns of the fit and to the deviations of the bench, both whitened and extended
by the rows of the prior,

    E = s − J (JᵀJ)⁻¹ Jᵀ s,   fall = (E·r)²/(E·E)

where E is the part of the signature that no fitted parameter can reproduce, and `fall` the predicted fall of χ² after
the parameters have been refitted. The prediction is linear in the size of the candidate, and a wrong model biases the
parameters, so it only ranks candidates and starts their fits.

Source: Rao's score test, with signatures of finite size because local derivatives mislead where effects are nonlinear.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.least_squares import OVERFLOW_LIMIT
from edhas_jax.diagnosis.calibration.symmetric_matrices import regularised_inverse
from edhas_jax.diagnosis.likelihood.run_equations import run_columns
from edhas_jax.diagnosis.likelihood.whitening import whiten
from edhas_jax.diagnosis.search.candidates import Candidate, screening_grid, with_candidate
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

MIN_PROJECTED_SHARE = 1e-12  # of a signature's square: below it the projection leaves only rounding errors
MAX_SCALE, MIN_SCALE = 4.0, 0.25  # scale factors of a signature beyond which another grid point is nearer
SMALL_SIZE = 0.1  # of a signature, of a start that is hardly above the model without the candidate
EXPONENTS = 0.5, 2.0  # smallest and largest magnitude of the power with which a signature grows


@dataclasses.dataclass(frozen=True)
class Score:
    """Result of the score test of one candidate at the best point of its grid.

    Args:
        candidate: what was tested.
        chi_square_fall: predicted fall of χ² (chi-square scale), 0 where none is predicted.
        x: coordinates (n,) of its unknowns, the size scaled to the predicted optimum.
        exponent: power of its first unknown with which the signature grows; negative where a stiffness, for example,
            makes the candidate vanish as it grows.
        point: the grid point (n,) itself, with the size that was simulated; None where there is no grid.
    """

    candidate: Candidate
    chi_square_fall: float
    x: np.ndarray
    exponent: float = 1.0
    point: np.ndarray | None = None

    @property
    def predicted_gain(self) -> float:
        """Half the predicted fall of χ²: the log-evidence gain [nats] it predicts, without the parameter penalty."""
        return 0.5 * self.chi_square_fall


@dataclasses.dataclass(frozen=True)
class Signatures:
    """The signatures of a candidate at the grid points where they are finite and not zero.

    Args:
        candidate: the candidate.
        points: coordinates (k, n) of its unknowns.
        rows: whitened changes of the signals (k, m), in single precision.
        exponent: see `Score`.
    """

    candidate: Candidate
    points: np.ndarray
    rows: np.ndarray
    exponent: float

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """The square (k,) of each row."""
        return np.einsum("km,km->k", self.rows, self.rows, dtype=float)


class ScoreTest:
    """The score test of candidates against one calibrated model.

    Args:
        fit: the calibrated model, with the outcomes and sensitivities of its runs.
        accepted: candidates that are mounted in that model already.
    """

    def __init__(self, fit: Fit, accepted: Sequence[Candidate]):
        self._fit, self._accepted = fit, tuple(accepted)
        self._model, self._campaign = fit.problem.model(), fit.problem.campaign
        self._valid = [np.isfinite(self._whitened_run(r, run.signals)) for r, run in enumerate(self._model.runs)]
        # signatures are differences, so both sides are simulated with the same coarse step
        self._baseline = self._model.predict_all_runs(fit.x, fit.resolution.coarse)

    @property
    def residual(self) -> np.ndarray:
        """The whitened residual of all samples, followed by that of the priors (m + q,)."""
        return self._residual_and_basis[0]

    @functools.cached_property
    def _residual_and_basis(self) -> tuple[np.ndarray, np.ndarray]:
        """`residual`, and an orthonormal basis (m + q, q) of what the unknowns and the bench change in it."""
        problem, columns = self._fit.problem, []
        for run, outcome in zip(self._model.runs, self._fit.outcomes, strict=True):
            columns.append(run_columns(self._campaign, run, outcome, problem.unknowns, problem.bench)[0])
        prior = np.array([float(u.has_prior) for u in problem.unknowns])
        own, samples = len(problem.bench.of_runs), sum(len(rows) for rows in columns)
        shared = columns[0].shape[1] - own - 1
        basis = np.zeros((samples + shared + own * len(columns), shared + own * len(columns)))
        start = 0
        for r, rows in enumerate(columns):  # the deviations of a run have rows of their own
            stop = start + len(rows)
            basis[start:stop, :shared] = rows[:, own:-1]
            basis[start:stop, shared + own * r : shared + own * (r + 1)] = rows[:, :own]
            start = stop
        weights = np.concatenate([prior, np.ones(basis.shape[1] - len(prior))])
        basis[samples:] = np.diag(weights)
        pull = np.concatenate([-prior * self._fit.x, np.zeros(len(weights) - len(prior))])
        return np.concatenate([*(rows[:, -1] for rows in columns), pull]), np.linalg.qr(basis)[0]

    def score(self, candidate: Candidate) -> Score:
        """The score at the best grid point; its fall of χ² is 0 where the model fails or no fall is predicted."""
        unknowns = candidate.unknowns(self._campaign)
        points = screening_grid(unknowns)
        found = [(x, row) for x, row in zip(points, self._projected(candidate, points), strict=True) if row is not None]
        exponent = _size_exponent(unknowns, found)
        best = Score(candidate, 0.0, points[0], exponent)
        for x, projected in found:
            square, overlap = projected @ projected, projected @ self.residual
            scale = np.clip(overlap / square, 0.0, MAX_SCALE)
            fall = scale * (2.0 * overlap - scale * square)
            if fall > best.chi_square_fall:
                start = with_scaled_size(unknowns, x, max(scale, MIN_SCALE), exponent)
                best = Score(candidate, float(fall), start, exponent, x)
        return best

    def score_columns(self, candidate: Candidate, columns: Sequence[Mapping[str, np.ndarray]]) -> Score:
        """The score of a candidate that is linear in its unknowns, each with a standard normal prior.

        Args:
            candidate: the candidate.
            columns: by fitted run and signal (samples, k) in SI, the change by a unit of each of its k coordinates.
        """
        count = next(iter(columns[0].values())).shape[1]
        rows = [self._whitened_run(r, run)[self._valid[r]] for r, run in enumerate(columns)]
        residual, basis = self._residual_and_basis
        stacked = np.concatenate([*rows, np.zeros((basis.shape[1], count))])
        if not (np.abs(stacked) < OVERFLOW_LIMIT).all():
            return Score(candidate, 0.0, np.zeros(count))
        projected = stacked - basis @ (basis.T @ stacked)
        overlap = projected.T @ residual
        x = regularised_inverse(projected.T @ projected + np.eye(count)) @ overlap
        return Score(candidate, float(overlap @ x), x)

    def signatures(self, candidate: Candidate) -> Signatures:
        """The whitened signatures of a candidate at its grid points."""
        unknowns = candidate.unknowns(self._campaign)
        points = screening_grid(unknowns)
        every = zip(points, self._signatures(candidate, points), strict=True)
        found = [(x, row) for x, row in every if (np.abs(row) < OVERFLOW_LIMIT).all() and row.any()]
        stack = np.array([row for _, row in found], np.float32).reshape(len(found), self.ends[-1])
        return Signatures(candidate, np.array([x for x, _ in found]), stack, _size_exponent(unknowns, found))

    def whitened(self, columns: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """Columns by fitted run and signal (samples, k) in SI as whitened ones (m, k) of all runs together."""
        return np.concatenate([self._whitened_run(r, run)[self._valid[r]] for r, run in enumerate(columns)])

    @property
    def ends(self) -> np.ndarray:
        """Where the signals of the runs end among the m samples of `whitened`."""
        lengths = []
        for run, valid in zip(self._model.runs, self._valid, strict=True):
            starts = np.cumsum([0, *(len(values) for values in run.signals.values())])[:-1]
            lengths += list(np.add.reduceat(valid.astype(int), starts))
        return np.cumsum(lengths)

    def _projected(self, candidate: Candidate, points: np.ndarray) -> list[np.ndarray | None]:
        """The part of each signature orthogonal to the sensitivities; None where not finite or mere rounding."""
        basis = self._residual_and_basis[1]
        rows = [np.concatenate([row, np.zeros(basis.shape[1])]) for row in self._signatures(candidate, points)]
        signatures = np.array(rows).T
        finite = (np.abs(signatures) < OVERFLOW_LIMIT).all(axis=0)
        signatures = np.where(finite, signatures, 0.0)
        projected = signatures - basis @ (basis.T @ signatures)
        squares, kept = np.sum(np.square(signatures), axis=0), np.sum(np.square(projected), axis=0)
        usable = finite & (kept > MIN_PROJECTED_SHARE * squares)
        return [column if ok else None for column, ok in zip(projected.T, usable, strict=True)]

    def _signatures(self, candidate: Candidate, points: np.ndarray) -> list[np.ndarray]:
        """The whitened change of the signals by a candidate at each grid point."""
        out = []
        with np.errstate(over="ignore", invalid="ignore"):  # a candidate with which the model diverges is skipped later
            for changes in self._changes_of(candidate, points):
                parts = [self._whitened_run(r, change)[self._valid[r]] for r, change in enumerate(changes)]
                out.append(np.concatenate(parts))
        return out

    def _changes_of(self, candidate: Candidate, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The change of the signals by a candidate, for each grid point and run (samples,) by signal, SI."""
        simulate = self._with_sensor_fault if candidate.signal is not None else self._with_effect
        for signals in simulate(candidate, points):
            yield [
                {n: found[n] - self._baseline[r].values[n] for n in self._model.runs[r].signals}
                for r, found in enumerate(signals)
            ]

    def _whitened_run(self, r: int, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """The signals of a run, whitened and concatenated in the order in which it records them."""
        rows = []
        for n, measured in self._model.runs[r].signals.items():
            values = np.array(signals[n], float)
            values[~np.isfinite(measured)] = np.nan
            rows.append(whiten(values, self._campaign.channels[n]))
        return np.concatenate(rows)

    def _with_effect(self, candidate: Candidate, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with an effect added, all other unknowns at their fitted values."""
        fitted = self._fit.problem
        problem = dataclasses.replace(with_candidate(fitted, self._accepted, candidate), runs=fitted.runs)
        estimates = {u.name: u.value(x) for u, x in zip(fitted.unknowns, self._fit.x, strict=True)}
        x = [u.coordinate(estimates[u.name]) if u.name in estimates else 0.0 for u in problem.unknowns]
        run_indices = tuple(range(len(self._model.runs)))
        cases = [EvaluationPoint(np.concatenate([x[: len(x) - len(own)], own]), run_indices) for own in points]
        for found in problem.model().predict(cases, self._fit.resolution.coarse, with_sensitivities=False):
            yield [found[r].values for r in run_indices]

    def _with_sensor_fault(self, candidate: Candidate, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with a fault of one sensor added."""
        unknowns, runs = candidate.unknowns(self._campaign), self._model.runs
        for x in points:
            values = {u.name.removeprefix(candidate.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            faulty = Instruments({candidate.signal: (candidate.kind(**values),)})
            yield [faulty.record(run.time, self._baseline[r].values, None, (), ())[0] for r, run in enumerate(runs)]


def _size_exponent(unknowns: Sequence[UnknownParameter], found: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """The power of the first unknown with which a signature grows, from signatures at grid points; see `Score`."""
    if not unknowns or unknowns[0].scale is not ParameterScale.LOGARITHMIC:
        return 1.0
    slopes = [
        math.log(np.linalg.norm(to) / np.linalg.norm(row)) / math.log(unknowns[0].value(y[0]) / unknowns[0].value(x[0]))
        for (x, row), (y, to) in itertools.combinations(found, 2)
        if y[0] != x[0] and (y[1:] == x[1:]).all()
    ]
    exponent = float(np.median(slopes)) if slopes else 1.0
    return math.copysign(np.clip(abs(exponent), *EXPONENTS), exponent)


def with_scaled_size(
    unknowns: Sequence[UnknownParameter], x: np.ndarray, scale: float, exponent: float = 1.0
) -> np.ndarray:
    """Coordinates (n,) of a candidate with its signature multiplied by a factor, by a change of its first unknown.

    Args:
        unknowns: the unknowns of the candidate.
        x: their coordinates (n,).
        scale: the factor.
        exponent: power of the first unknown with which the signature grows, see `Score`.
    """
    out = np.array(x, float)
    if unknowns:
        value = scale ** (1.0 / exponent) * float(unknowns[0].value(x[0]))
        out[0] = np.clip(unknowns[0].coordinate(value), *unknowns[0].bounds())
    return out
