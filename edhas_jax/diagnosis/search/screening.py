"""Which suspects could explain what a calibrated model leaves over: signatures that no known parameter can imitate.

The signature of a suspect is what it adds to the signals when it is mounted at a finite size. With r the residual and J
the slopes of the signals by the unknowns of the fit, both in units of noise and continued by the prior,

    E = s − J (JᵀJ)⁻¹ Jᵀ s,   score = (E·r)²/(E·E)

is the fall of χ² that the suspect promises once the known parameters have been fitted anew. It is a screen: effects are
not linear in their size, and a wrong model hides physics in its parameters, so the verdict is left to refits.

Source: Rao's score test; signatures of finite size as the local score is misled by strong nonlinearity.
"""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Suspect, grid, problem_of, unknowns_of
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.unknown_parameters import UnknownParameter

DISTINCT = 1e-2  # of the largest eigenvalue: combinations below it are differences of nearly equal signatures
LARGEST, SMALLEST = 4.0, 0.25  # a signature may be scaled that far before another point of the grid is nearer


@dataclasses.dataclass(frozen=True)
class Score:
    """What a suspect promises: the fall of χ², at which coordinates of its own parameters, and how visible it is.

    `survives` is the share of the signature's length that no known parameter imitates; `length` what is left of it, in
    units of noise, and `signature` the direction of what is left (m,).
    """

    suspect: Suspect
    fall: float
    x: np.ndarray
    survives: float
    length: float
    signature: np.ndarray


class Screen:
    """The residual of a fit and the slopes of its unknowns, ready to be asked about suspects."""

    def __init__(self, fit: Fit, accepted: Sequence[Suspect]):
        self._fit, self._accepted = fit, tuple(accepted)
        self._model, self._campaign = fit.problem.model(), fit.problem.campaign
        measured = self._flat([run.signals for run in self._model.runs])
        self._there = np.isfinite(measured)
        residual = (measured - self._flat([out.values for out in fit.outcomes]))[self._there]
        prior = np.array([float(u.has_prior) for u in fit.problem.unknowns])
        slopes = self._flat([out.sensitivities for out in fit.outcomes])[self._there]
        self.residual = np.concatenate([residual, -prior * fit.x])
        self._known = np.linalg.qr(np.concatenate([slopes, np.diag(prior)]))[0]
        # signatures are differences: both sides at the same, rough, step
        self._base = self._model.predict_all_runs(fit.x, fit.resolution.coarse)

    def score(self, suspect: Suspect) -> Score:
        """The best point of a suspect's grid; a fall of 0 where it cannot be simulated or promises nothing."""
        return self._asked(suspect)[0]

    def together(self, suspects: Iterable[Suspect]) -> tuple[list[Score], float]:
        """The scores of some suspects, the best first, and the fall of χ² that their signatures promise together."""
        scores, every = [], []
        for suspect in suspects:
            score, found = self._asked(suspect)
            scores.append(score)
            every += [left / np.linalg.norm(left) for left in found]
        scores.sort(key=lambda score: -score.fall)
        if not every:
            return scores, 0.0
        stack = np.array(every)
        weights, directions = np.linalg.eigh(stack @ stack.T)
        ok = weights > DISTINCT * weights[-1]
        return scores, float(np.sum(np.square(directions[:, ok].T @ (stack @ self.residual)) / weights[ok]))

    def _asked(self, suspect: Suspect) -> tuple[Score, list[np.ndarray]]:
        """The score of a suspect, and what no known parameter imitates of its signatures at the points of its grid."""
        unknowns = unknowns_of(suspect, self._campaign)
        points = grid(suspect, unknowns)
        best, every = Score(suspect, 0.0, points[0], 0.0, 0.0, np.zeros(len(self.residual))), []
        for x, signature in zip(points, self._signatures(suspect, points), strict=True):
            left = self._left(signature)
            if left is None:
                continue
            every.append(left)
            square, whole, along = left @ left, signature @ signature, left @ self.residual
            scale = np.clip(along / square, 0.0, LARGEST)
            fall = scale * (2.0 * along - scale * square)
            if fall > best.fall:
                length = np.sqrt(square)
                at = _scaled(unknowns, x, max(scale, SMALLEST))
                best = Score(suspect, float(fall), at, float(length / np.sqrt(whole)), float(length), left / length)
        return best, every

    def _left(self, signature: np.ndarray) -> np.ndarray | None:
        """What of a signature no known parameter imitates; None where it is not finite or nothing is."""
        if not np.isfinite(signature).all():
            return None
        left = signature - self._known @ (self._known.T @ signature)
        return None if left @ left <= 1e-12 * (signature @ signature) else left

    def _signatures(self, suspect: Suspect, points: np.ndarray) -> list[np.ndarray]:
        """What the suspect adds to the signals, in units of noise, at each point of its grid."""
        base = self._flat([self._base[r].values for r in range(len(self._model.runs))])
        changed = self._recorded if suspect.signal is not None else self._simulated
        nothing = np.zeros(len(self._fit.x))
        return [np.concatenate([(self._flat(run) - base)[self._there], nothing]) for run in changed(suspect, points)]

    def _simulated(self, suspect: Suspect, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with an effect mounted, everything else as it was fitted."""
        fitted = self._fit.problem
        problem = problem_of(self._campaign, fitted.machine, fitted.instruments, self._accepted, suspect)
        problem = dataclasses.replace(problem, runs=fitted.runs)
        known = {u.name: u.value(x) for u, x in zip(fitted.unknowns, self._fit.x, strict=True)}
        at = [u.coordinate(known[u.name]) if u.name in known else 0.0 for u in problem.unknowns]
        every = tuple(range(len(self._model.runs)))
        cases = [EvaluationPoint(np.concatenate([at[: len(at) - len(x)], x]), every) for x in points]
        for found in problem.model().predict(cases, self._fit.resolution.coarse, with_sensitivities=False):
            yield [found[r].values for r in every]

    def _recorded(self, suspect: Suspect, points: np.ndarray) -> Iterator[list[dict[str, np.ndarray]]]:
        """The signals of every run with a fault of one sensor."""
        unknowns, runs = unknowns_of(suspect, self._campaign), self._model.runs
        for x in points:
            values = {u.name.removeprefix(suspect.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            faulty = Instruments({suspect.signal: (suspect.kind(**values),)})
            yield [faulty.record(run.time, self._base[r].values, None, (), ())[0] for r, run in enumerate(runs)]

    def _flat(self, runs: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """Signals (n,) or slopes (n, unknowns) of all runs one below the other, in units of noise."""
        rows = []
        with np.errstate(over="ignore"):  # a suspect that makes the model blow up is passed over
            for run, found in zip(self._model.runs, runs, strict=True):
                rows += [found[n] / channel.noise for n, channel in self._campaign.channels.items() if n in run.signals]
        return np.concatenate(rows)


def _scaled(unknowns: Sequence[UnknownParameter], x: np.ndarray, scale: float) -> np.ndarray:
    """The coordinates with the size of an effect, its first unknown, multiplied by `scale`."""
    out = np.array(x, float)
    if unknowns:
        out[0] = np.clip(unknowns[0].coordinate(scale * float(unknowns[0].value(x[0]))), *unknowns[0].bounds())
    return out


def overlap(one: Score, other: Score) -> float:
    """How alike two suspects look once the known parameters are fitted: the cosine of what is left, 0 … 1."""
    return float(abs(one.signature @ other.signature))
