"""Signatures of candidate effects, and the part of them that no known parameter can reproduce.

A candidate with parameters x changes the signals by s(x), its signature, in units of noise. With J the derivatives of
the signals by the p uncertain parameters of the machine and P = diag(1 where a parameter has a prior), the part of s
that no other values of these parameters can explain is the residual of a regularised projection,

    E = s − J (JᵀJ + P)⁻¹ Jᵀ s,   |E|² = sᵀs − sᵀJ (JᵀJ + P)⁻¹ Jᵀs

Only inner products of the columns of [J, s] are needed. These Gram matrices add up over runs, so that runs can be added
or removed without a further simulation.
"""

import dataclasses
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.search.signatures import signals_with
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.least_squares import OVERFLOW_LIMIT
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

ROUNDING_SHARE = 1e-12  # share of the squared norm of a signature below which a projection is rounding


class CandidatePoints(NamedTuple):
    """A candidate and some values of its own n parameters, in coordinates: shape (points, n)."""

    candidate: Candidate
    points: np.ndarray


class SignatureGram:
    """Gram matrices, run by run, of the derivatives by p known parameters and of k signatures.

    Attributes:
        per_run: inner products over the samples of a run, in units of noise, shape (runs, p + k, p + k).
        failed: signatures whose simulation is not finite, shape (k,); their rows and columns are 0.
    """

    def __init__(
        self, campaign: Campaign, runs: Sequence[BenchRun], candidates: Sequence[CandidatePoints], per_sample: int,
        on_progress: Callable[[str, float], None],
    ):  # fmt: skip
        """Simulate all signatures.

        Args:
            campaign: machine, channels with their noise, and uncertain parameters.
            runs: conditions and sampling; signals only say which channels count, all of them where there are none.
            candidates: the candidates and the parameter values at which their signatures are computed.
            per_sample: integration steps per sample.
            on_progress: called with the name of a stage and the share done.
        """
        self._campaign, self._runs = campaign, tuple(runs)
        known = dataclasses.replace(calibration_problem(campaign), runs=self._runs)
        self._prior = np.array([float(u.has_prior) for u in known.unknowns])
        all_runs = tuple(range(len(self._runs)))
        on_progress("derivatives with respect to the uncertain parameters", 0.0)
        model = MeasurementModel(campaign, campaign.machine, known.unknowns, self._runs)
        count = len(known.unknowns)
        outcomes = model.predict_all_runs(np.zeros(count), per_sample, with_sensitivities=count > 0)
        nominal = [outcomes[r].values for r in all_runs]
        slopes = [
            outcomes[r].sensitivities or {n: v[:, None][:, :0] for n, v in outcomes[r].values.items()} for r in all_runs
        ]
        columns = [[self._over_noise(r, slopes[r])] for r in all_runs]
        for k, one in enumerate(candidates):
            on_progress(one.candidate.name, k / len(candidates))
            for signals in signals_with(one.candidate, one.points, known, {}, per_sample, nominal):
                for r in all_runs:
                    change = {n: signals[r][n] - nominal[r][n] for n in signals[r]}
                    columns[r].append(self._over_noise(r, change)[:, None])
        tables = [np.concatenate(parts, axis=1) for parts in columns]
        # not finite, or so large that its square would not be
        failed = ~np.all([(np.abs(table) < OVERFLOW_LIMIT).all(axis=0) for table in tables], axis=0)
        for table in tables:
            table[:, failed] = 0.0
        self.failed = failed[count:]
        self.per_run = np.array([table.T @ table for table in tables])

    def unexplained(self, runs: Sequence[int] | slice = slice(None)) -> np.ndarray:
        """EᵀE of all signatures over the runs with these indices, shape (k, k)."""
        return self.project(self.per_run[runs].sum(axis=0))

    def project(self, gram: np.ndarray) -> np.ndarray:
        """EᵀE, shape (k, k), from a Gram matrix (p + k, p + k) summed over runs: its Schur complement."""
        p = len(self._prior)
        signatures, mixed, known = gram[p:, p:], gram[:p, p:], gram[:p, :p] + np.diag(self._prior)
        projected = signatures - mixed.T @ regularised_inverse(known) @ mixed
        square = np.maximum(np.diag(projected), ROUNDING_SHARE * np.diag(signatures))
        projected[np.diag_indices_from(projected)] = square
        return projected

    def _over_noise(self, r: int, by_signal: dict[str, np.ndarray]) -> np.ndarray:
        """Signals (samples,) or derivatives (samples, p) of a run in units of noise, concatenated over the signals."""
        names = self._runs[r].signals or self._campaign.channels
        return np.concatenate([by_signal[n] / self._campaign.channels[n].noise for n in names])


def cosines(unexplained: np.ndarray) -> np.ndarray:
    """Absolute cosines between signatures from EᵀE (k, k): 1 for indistinguishable ones, 0 where one vanishes."""
    norm = np.sqrt(np.diag(unexplained))
    norm = np.where(norm > 0.0, norm, np.inf)
    return np.abs(unexplained / np.outer(norm, norm))
