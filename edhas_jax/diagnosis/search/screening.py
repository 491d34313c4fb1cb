"""Projected score test: which candidates could explain the residual of a calibrated model.

The signature s of a candidate is the change of the signals when it is added at a finite size. With r the residual and J
the sensitivity of the signals to the unknowns of the fit, both in units of noise and extended by the rows of the prior,

    E = s − J (JᵀJ)⁻¹ Jᵀ s,   fall = (E·r)²/(E·E)

where E is the part of the signature that no fitted parameter can reproduce, and `fall` the predicted fall of χ² after
the parameters have been refitted. The prediction is linear in the size of the candidate, and a wrong model biases the
parameters, so it only ranks candidates for trials; refits decide.

Source: Rao's score test, with signatures of finite size because local derivatives mislead where effects are nonlinear.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem, candidate_unknowns, screening_grid
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.unknown_parameters import UnknownParameter

MIN_RELATIVE_EIGENVALUE = 1e-2  # of the largest: smaller ones are differences of nearly equal signatures
MIN_PROJECTED_SHARE = 1e-12  # of a signature's square: below it the projection leaves only rounding errors
MAX_SCALE, MIN_SCALE = 4.0, 0.25  # scale factors of a signature beyond which another grid point is nearer


@dataclasses.dataclass(frozen=True)
class Score:
    """Result of the score test of one candidate at the best point of its grid.

    Args:
        candidate: what was tested.
        chi_square_fall: predicted fall of χ² (chi-square scale), 0 where none is predicted.
        x: coordinates (n,) of its unknowns, the size scaled to the predicted optimum; start of a trial.
        direction: projected signature (m,) of unit length, over all samples and the rows of the prior.
    """

    candidate: Candidate
    chi_square_fall: float
    x: np.ndarray
    direction: np.ndarray

    @property
    def predicted_gain(self) -> float:
        """Half the predicted fall of χ²: the log-evidence gain [nats] it predicts, without the parameter penalty."""
        return 0.5 * self.chi_square_fall


class ScoreTest:
    """The score test of candidates against one calibrated model.

    Args:
        fit: the calibrated model, with the outcomes and sensitivities of its runs.
        accepted: candidates that are mounted in that model already.
    """

    def __init__(self, fit: Fit, accepted: Sequence[Candidate]):
        self._fit, self._accepted = fit, tuple(accepted)
        self._model, self._campaign = fit.problem.model(), fit.problem.campaign
        measured = self._stacked([run.signals for run in self._model.runs])
        self._valid = np.isfinite(measured)
        residual = (measured - self._stacked([out.values for out in fit.outcomes]))[self._valid]
        prior = np.array([float(u.has_prior) for u in fit.problem.unknowns])
        slopes = self._stacked([out.sensitivities for out in fit.outcomes])[self._valid]
        self.residual = np.concatenate([residual, -prior * fit.x])
        self._sensitivity_basis = np.linalg.qr(np.concatenate([slopes, np.diag(prior)]))[0]
        # signatures are differences, so both sides are simulated with the same coarse step
        self._baseline = self._model.predict_all_runs(fit.x, fit.resolution.coarse)

    def score(self, candidate: Candidate) -> Score:
        """The score at the best grid point; its fall of χ² is 0 where the model fails or no fall is predicted."""
        return self._score_grid(candidate)[0]

    def projected_residual(self) -> np.ndarray:
        """The residual (m,) without the part that the fitted parameters can still reproduce."""
        return self.residual - self._sensitivity_basis @ (self._sensitivity_basis.T @ self.residual)

    def projected_signatures(self, candidate: Candidate) -> list[np.ndarray]:
        """The projected signatures (m,) of a candidate, one for each grid point that has one."""
        return self._score_grid(candidate)[1]

    def joint_scores(self, candidates: Iterable[Candidate]) -> tuple[list[Score], float]:
        """Score candidates separately and jointly.

        Returns:
            The scores, the largest fall first, and the predicted fall of χ² of the best linear combination of the
            signatures of all candidates at all their grid points.
        """
        scores, unit_signatures = [], []
        for candidate in candidates:
            score, projected = self._score_grid(candidate)
            scores.append(score)
            unit_signatures += [row / np.linalg.norm(row) for row in projected]
        scores.sort(key=lambda score: -score.chi_square_fall)
        if not unit_signatures:
            return scores, 0.0
        stack = np.array(unit_signatures)
        eigenvalues, vectors = np.linalg.eigh(stack @ stack.T)
        ok = eigenvalues > MIN_RELATIVE_EIGENVALUE * eigenvalues[-1]
        falls = np.square(vectors[:, ok].T @ (stack @ self.residual)) / eigenvalues[ok]
        return scores, float(np.sum(falls))

    def _score_grid(self, candidate: Candidate) -> tuple[Score, list[np.ndarray]]:
        """The score of a candidate, and its projected signatures at all grid points that have one."""
        unknowns = candidate_unknowns(candidate, self._campaign)
        points = screening_grid(unknowns)
        best = Score(candidate, 0.0, points[0], np.zeros(len(self.residual)))
        all_projected = []
        for x, signature in zip(points, self._signatures(candidate, points), strict=True):
            projected = self._project(signature)
            if projected is None:
                continue
            all_projected.append(projected)
            square, overlap = projected @ projected, projected @ self.residual
            scale = np.clip(overlap / square, 0.0, MAX_SCALE)
            fall = scale * (2.0 * overlap - scale * square)
            if fall > best.chi_square_fall:
                start = _with_scaled_size(unknowns, x, max(scale, MIN_SCALE))
                best = Score(candidate, float(fall), start, projected / np.sqrt(square))
        return best, all_projected

    def _project(self, signature: np.ndarray) -> np.ndarray | None:
        """The part of a signature orthogonal to the sensitivities; None where not finite, or only rounding is left."""
        if not np.isfinite(signature).all():
            return None
        projected = signature - self._sensitivity_basis @ (self._sensitivity_basis.T @ signature)
        return None if projected @ projected <= MIN_PROJECTED_SHARE * (signature @ signature) else projected

    def _signatures(self, candidate: Candidate, points: np.ndarray) -> list[np.ndarray]:
        """The change of the signals by a candidate, in units of noise, at each grid point."""
        base = self._stacked([self._baseline[r].values for r in range(len(self._model.runs))])
        simulate = self._with_sensor_fault if candidate.signal is not None else self._with_effect
        prior_rows = np.zeros(len(self._fit.x))
        changes = ((self._stacked(run) - base)[self._valid] for run in simulate(candidate, points))
        return [np.concatenate([change, prior_rows]) for change in changes]

    def _with_effect(self, candidate: Candidate, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with an effect added, all other unknowns at their fitted values."""
        fitted = self._fit.problem
        problem = build_problem(self._campaign, fitted.machine, fitted.instruments, self._accepted, candidate)
        problem = dataclasses.replace(problem, runs=fitted.runs)
        estimates = {u.name: u.value(x) for u, x in zip(fitted.unknowns, self._fit.x, strict=True)}
        x = [u.coordinate(estimates[u.name]) if u.name in estimates else 0.0 for u in problem.unknowns]
        run_indices = tuple(range(len(self._model.runs)))
        cases = [EvaluationPoint(np.concatenate([x[: len(x) - len(own)], own]), run_indices) for own in points]
        for found in problem.model().predict(cases, self._fit.resolution.coarse, with_sensitivities=False):
            yield [found[r].values for r in run_indices]

    def _with_sensor_fault(self, candidate: Candidate, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with a fault of one sensor added."""
        unknowns, runs = candidate_unknowns(candidate, self._campaign), self._model.runs
        for x in points:
            values = {u.name.removeprefix(candidate.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            faulty = Instruments({candidate.signal: (candidate.kind(**values),)})
            yield [faulty.record(run.time, self._baseline[r].values, None, (), ())[0] for r, run in enumerate(runs)]

    def _stacked(self, runs: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """Signals (m,) or sensitivities (m, unknowns) of all runs, concatenated, in units of noise."""
        rows = []
        with np.errstate(over="ignore"):  # a candidate that makes the model diverge is skipped later
            for run, found in zip(self._model.runs, runs, strict=True):
                rows += [found[n] / channel.noise for n, channel in self._campaign.channels.items() if n in run.signals]
        return np.concatenate(rows)


def _with_scaled_size(unknowns: Sequence[UnknownParameter], x: np.ndarray, scale: float) -> np.ndarray:
    """The coordinates with the first unknown, the size of a candidate, multiplied by `scale` in SI."""
    out = np.array(x, float)
    if unknowns:
        out[0] = np.clip(unknowns[0].coordinate(scale * float(unknowns[0].value(x[0]))), *unknowns[0].bounds())
    return out
