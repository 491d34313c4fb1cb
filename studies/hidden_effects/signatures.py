"""The table of signatures: what each suspect would change in the signals of a calibrated model.

A signature is the change of the signals when a suspect is added at a finite size, in units of noise, all else at its
fitted value. Correlated noise is made white first, by one filter for residual and signatures. Every suspect is
evaluated at the sizes and shapes at which the diagnosis evaluates it. What the uncertain parameters and the usual
errors of a bench can reproduce within their priors is projected out of residual and signatures.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate, signature_grid
from edhas_jax.diagnosis.search.signatures import signals_with
from edhas_jax.inference.fit.fit import Fit
from studies.hidden_effects.bench_errors import bench_error_changes
from studies.hidden_effects.whitening import whitened

MIN_PROJECTED_SHARE = 1e-12  # of a signature's square: below it the projection leaves only rounding errors


@dataclasses.dataclass(frozen=True)
class Signatures:
    """The signatures of one suspect.

    Args:
        candidate: the suspect.
        points: coordinates (k, n) of its n free parameters.
        rows: change of the signals (k, m) at each point, in units of noise.
    """

    candidate: Candidate
    points: np.ndarray
    rows: np.ndarray

    @property
    def name(self) -> str:
        """The name of the suspect."""
        return self.candidate.name


@dataclasses.dataclass(frozen=True)
class SignatureTable:
    """Residual, sensitivities and signatures at the m measured samples of the fitted runs, in units of noise.

    Args:
        signal: index of the signal of each sample (m,).
        signal_names: names of the signals.
        residual: measured less model (m,).
        slopes: derivatives (m, p) of the signals by the coordinates of uncertain parameters and errors of the bench.
        x: fitted coordinates (p,), 0 for errors of the bench; their prior is standard normal.
        has_prior: whether each of them has one (p,).
        suspects: the signatures of the suspects that have any.
    """

    signal: np.ndarray
    signal_names: tuple[str, ...]
    residual: np.ndarray
    slopes: np.ndarray
    x: np.ndarray
    has_prior: np.ndarray
    suspects: tuple[Signatures, ...]

    @functools.cached_property
    def _basis(self) -> np.ndarray:
        """Orthonormal basis (m + p, p) of what the coordinates change, in the signals and in their priors."""
        return np.linalg.qr(np.concatenate([self.slopes, np.diag(self.has_prior.astype(float))]))[0]

    def _project(self, rows: np.ndarray) -> np.ndarray:
        """Rows (k, m + p) less what the coordinates can reproduce."""
        return rows - (rows @ self._basis) @ self._basis.T

    @functools.cached_property
    def projected_residual(self) -> np.ndarray:
        """The residual (m + p,), with the rows of the prior, less what the coordinates can reproduce."""
        return self._project(np.concatenate([self.residual, -1.0 * self.has_prior * self.x])[None])[0]

    @property
    def unexplained(self) -> np.ndarray:
        """The residual (m,) less what the coordinates explain of it within their priors."""
        return self.projected_residual[: len(self.residual)]

    def projected(self, suspect: Signatures) -> np.ndarray:
        """The projected signatures (k, m + p) of a suspect; those of which only rounding errors remain are zero."""
        rows = np.concatenate([suspect.rows, np.zeros((len(suspect.rows), len(self.x)))], axis=1)
        found = self._project(rows)
        too_small = np.sum(found**2, axis=1) <= MIN_PROJECTED_SHARE * np.sum(rows**2, axis=1)
        found[too_small] = 0.0
        return found


def signature_table(fitted: Fit, candidates: Sequence[Candidate]) -> SignatureTable:
    """The table of a fit without the candidates.

    Args:
        fitted: the fit; its signals give the residual.
        candidates: the suspects.
    """
    model = fitted.problem.model()
    runs, channels = model.runs, fitted.problem.campaign.channels
    signals = tuple(channels)

    def stacked(found: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        with np.errstate(over="ignore", invalid="ignore"):  # a suspect with which the model diverges is left out below
            rows = [
                whitened(of[n] / channels[n].noise, channels[n].correlation)
                for run, of in zip(runs, found, strict=True)
                for n in run.signals
            ]
        return np.concatenate(rows)

    measured = stacked([run.signals for run in runs])
    valid = np.isfinite(measured)
    where = [(signals.index(n), len(run.time)) for run in runs for n in run.signals]
    base = model.predict_all_runs(fitted.x, fitted.resolution.coarse)
    without = [base[r].values for r in range(len(runs))]
    start = stacked(without)
    suspects = []
    for candidate in candidates:
        points = signature_grid(candidate.unknowns(fitted.problem.campaign))
        found = signals_with(candidate, points, fitted.problem, fitted.values, fitted.resolution.coarse, without)
        rows = np.array([stacked(of_runs) - start for of_runs in found])[:, valid]
        usable = np.isfinite(rows).all(axis=1) & rows.any(axis=1)
        if usable.any():
            suspects.append(Signatures(candidate, points[usable], rows[usable]))
    errors = [stacked(changes)[valid] for changes in bench_error_changes(fitted)]
    errors = np.array([change for change in errors if np.isfinite(change).all()]).reshape(-1, int(valid.sum()))
    return SignatureTable(
        np.repeat([s for s, _ in where], [n for _, n in where])[valid], signals,
        (measured - stacked([out.values for out in fitted.outcomes]))[valid],
        np.concatenate([stacked([out.sensitivities for out in fitted.outcomes])[valid], errors.T], axis=1),
        np.concatenate([fitted.x, np.zeros(len(errors))]),
        np.array([u.has_prior for u in fitted.problem.unknowns] + [True] * len(errors)), tuple(suspects),
    )  # fmt: skip
