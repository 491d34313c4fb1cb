"""Signatures of candidate effects, and the part of them that no known parameter can reproduce.

A candidate with parameters x changes the signals by s(x), its signature, in units of noise. With J the derivatives of
the signals by the p uncertain parameters of the machine and P = diag(1 where a parameter has a prior), the part of s
that no other values of these parameters can explain is the residual of a regularised projection,

    E = s − J (JᵀJ + P)⁻¹ Jᵀ s,   |E|² = sᵀs − sᵀJ (JᵀJ + P)⁻¹ Jᵀs

Only inner products of the columns of [J, s] are needed. These Gram matrices add up over runs, so that runs can be added
or removed without a further simulation.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.least_squares import OVERFLOW_LIMIT
from edhas_jax.diagnosis.calibration.symmetric_matrices import regularised_inverse
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel

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
        self._campaign, self._runs, self._steps = campaign, tuple(runs), per_sample
        known = build_problem(campaign, campaign.machine, Instruments(), ()).unknowns
        self._prior = np.array([float(u.has_prior) for u in known])
        all_runs = tuple(range(len(self._runs)))
        on_progress("derivatives with respect to the uncertain parameters", 0.0)
        model = MeasurementModel(campaign, campaign.machine, known, self._runs)
        outcomes = model.predict_all_runs(np.zeros(len(known)), per_sample, with_sensitivities=bool(known))
        self._nominal = [outcomes[r].values for r in all_runs]
        slopes = [
            outcomes[r].sensitivities or {n: v[:, None][:, :0] for n, v in outcomes[r].values.items()} for r in all_runs
        ]
        columns = [[self._over_noise(r, slopes[r])] for r in all_runs]
        for k, one in enumerate(candidates):
            on_progress(one.candidate.name, k / len(candidates))
            simulate = self._with_sensor_fault if one.candidate.signal is not None else self._with_effect
            for signals in simulate(one):
                for r in all_runs:
                    change = {n: signals[r][n] - self._nominal[r][n] for n in signals[r]}
                    columns[r].append(self._over_noise(r, change)[:, None])
        tables = [np.concatenate(parts, axis=1) for parts in columns]
        # not finite, or so large that its square would not be
        failed = ~np.all([(np.abs(table) < OVERFLOW_LIMIT).all(axis=0) for table in tables], axis=0)
        for table in tables:
            table[:, failed] = 0.0
        self.failed = failed[len(known) :]
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

    def _with_effect(self, one: CandidatePoints) -> list[list[dict[str, np.ndarray]]]:
        """The signals of every run with an effect in the model, for each of its points."""
        problem = build_problem(self._campaign, self._campaign.machine, Instruments(), (), one.candidate)
        model = MeasurementModel(self._campaign, problem.machine, problem.unknowns, self._runs, problem.instruments)
        all_runs = tuple(range(len(self._runs)))
        nominal = np.zeros(len(problem.unknowns) - one.points.shape[1])
        cases = [EvaluationPoint(np.concatenate([nominal, x]), all_runs) for x in one.points]
        return [
            [outcomes[r].values for r in all_runs]
            for outcomes in model.predict(cases, self._steps, with_sensitivities=False)
        ]

    def _with_sensor_fault(self, one: CandidatePoints) -> list[list[dict[str, np.ndarray]]]:
        """The signals of every run with a fault of one sensor, for each of its points."""
        candidate, by_point = one.candidate, []
        unknowns = candidate.unknowns(self._campaign)
        for x in one.points:
            values = {u.name.removeprefix(candidate.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            chain = Instruments({candidate.signal: (candidate.kind(**values),)})
            rows = zip(self._runs, self._nominal, strict=True)
            by_point.append([chain.record(run.time, signals, None, (), np.zeros(0))[0] for run, signals in rows])
        return by_point


def cosines(unexplained: np.ndarray) -> np.ndarray:
    """Absolute cosines between signatures from EᵀE (k, k): 1 for indistinguishable ones, 0 where one vanishes."""
    norm = np.sqrt(np.diag(unexplained))
    norm = np.where(norm > 0.0, norm, np.inf)
    return np.abs(unexplained / np.outer(norm, norm))
