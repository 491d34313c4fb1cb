"""Signatures: what every cause would change in the measurements, simulated at a fit, and whitened.

The signature of an effect or sensor fault is the change of the signals when it is added at a finite size, because local
derivatives mislead where effects are nonlinear; that of a free term is the change by each of its numbers. See
`linear_model` for what is made of them. The background is what free curves at all places together can do: the
directions of their smoothest shapes, each of unit length.
"""

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from typing import TypeVar

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm, signature_grid, with_candidates
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate, curves_with_slopes
from edhas_jax.diagnosis.candidates.memory_term import memories_with_slopes
from edhas_jax.inference.fit.evaluated_fit import start_coordinates
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

LARGEST_CHANGE = 1e15  # of a whitened signal: products of larger ones would overflow in single precision
MAX_SCALE, MIN_SCALE = 4.0, 0.25  # scale factors of a signature beyond which another grid point is nearer
SMALL_SIZE = 0.1  # of a signature, of a start that is hardly above the model without the candidate
EXPONENTS = 0.5, 2.0  # smallest and largest magnitude of the power with which a signature grows
SMOOTHEST = 4  # shapes of each curve that are in the background, about a cubic
MAX_DIRECTIONS, MIN_EIGENVALUE = 100, 1e-4  # of the background: their number, and the smallest one over the largest

SignalsOfRuns = list[Mapping[str, np.ndarray]]  # for each run (samples,) by signal, SI


@dataclasses.dataclass(frozen=True)
class Signatures:
    """The signatures of a candidate at the grid points where they are finite and not zero.

    Args:
        candidate: the candidate.
        points: coordinates (k, n) of its unknowns.
        rows: whitened changes of the signals (k, m), in single precision.
        exponent: power of its first unknown with which they grow; negative where a stiffness, for example, makes the
            candidate vanish as it grows.
    """

    candidate: Candidate
    points: np.ndarray
    rows: np.ndarray
    exponent: float

    @functools.cached_property
    def squares(self) -> np.ndarray:
        """The square (k,) of each row."""
        return np.einsum("km,km->k", self.rows, self.rows, dtype=float)


@dataclasses.dataclass(frozen=True)
class FreeSlopes:
    """A free term, and its rows (k, m): the change by a prior standard deviation of its first k numbers, whitened."""

    term: FreeTerm
    rows: np.ndarray
    gram: np.ndarray


Cause = TypeVar("Cause", Signatures, FreeSlopes)


@dataclasses.dataclass(frozen=True)
class SignatureTable:
    """The signatures of all causes.

    Args:
        candidates: effects and sensor faults with their signatures.
        free: the free terms: curves, memories and resonances.
        background: directions (m, g) of the background, whitened.
        ends: where the signals end among the m samples.
        rows: the rows of all candidates, of which theirs are views, and those of all free terms.
    """

    candidates: tuple[Signatures, ...]
    free: tuple[FreeSlopes, ...]
    background: np.ndarray
    ends: np.ndarray
    rows: tuple[np.ndarray, np.ndarray]

    def at(self, fit: Fit, without: Set[str]) -> "SignatureTable":
        """The table with the candidates simulated at the fit of another model, without those that this model has."""
        others = [of.candidate for of in self.candidates if of.candidate.name not in without]
        named, rows = _named(SignatureSimulator(fit), others)
        return dataclasses.replace(self, candidates=named, rows=(rows, self.rows[1]))


class SignatureSimulator:
    """Simulates the signatures of candidates at one fit.

    Args:
        fit: the fit of a model, with the outcomes and sensitivities of its runs.
    """

    def __init__(self, fit: Fit):
        self._fit, self._model, self._campaign = fit, fit.problem.model(), fit.problem.campaign
        self._valid = [np.isfinite(self._whitened_run(r, run.signals)) for r, run in enumerate(self._model.runs)]
        # signatures are differences, so both sides are simulated with the same step
        found = self._model.predict_all_runs(fit.x, fit.steps_of_changes)
        self._baseline = [found[r].values for r in range(len(self._model.runs))]

    @property
    def ends(self) -> np.ndarray:
        """Where the signals of the runs end among the m samples of `whitened`."""
        lengths = []
        for run, valid in zip(self._model.runs, self._valid, strict=True):
            starts = np.cumsum([0, *(len(values) for values in run.signals.values())])[:-1]
            lengths += list(np.add.reduceat(valid.astype(int), starts))
        return np.cumsum(lengths)

    def whitened(self, columns: Sequence[Mapping[str, np.ndarray]]) -> np.ndarray:
        """Columns by fitted run and signal (samples, …) in SI as whitened ones (m, …) of all runs together."""
        return np.concatenate([self._whitened_run(r, run)[self._valid[r]] for r, run in enumerate(columns)])

    def signatures(self, candidate: Candidate) -> Signatures:
        """The whitened signatures of a candidate at its grid points."""
        unknowns, steps, found = candidate.unknowns(self._campaign), self._fit.steps_of_changes, []
        points = signature_grid(unknowns)
        with np.errstate(over="ignore", invalid="ignore"):  # points at which the model diverges are left out
            every = signals_with(candidate, points, self._fit.problem, self._fit.values, steps, self._baseline)
            for x, of_runs in zip(points, every, strict=True):
                runs = zip(self._model.runs, of_runs, self._baseline, strict=True)
                row = self.whitened([{n: with_it[n] - base[n] for n in run.signals} for run, with_it, base in runs])
                if (np.abs(row) < LARGEST_CHANGE).all() and row.any():
                    found.append((x, row))
        stack = np.array([row for _, row in found], np.float32).reshape(len(found), self.ends[-1])
        return Signatures(candidate, np.array([x for x, _ in found]), stack, _size_exponent(unknowns, found))

    def _whitened_run(self, r: int, signals: Mapping[str, np.ndarray]) -> np.ndarray:
        """The signals of a run, whitened and concatenated in the order in which it records them."""
        rows = []
        for n, measured in self._model.runs[r].signals.items():
            values = np.array(signals[n], float)
            values[~np.isfinite(measured)] = np.nan
            rows.append(whiten(values, self._campaign.channels[n]))
        return np.concatenate(rows)


def signals_with(
    candidate: Candidate, points: np.ndarray, known: FitProblem, values: Mapping[str, float], steps_per_sample: int,
    without: SignalsOfRuns,
) -> Iterator[SignalsOfRuns]:  # fmt: skip
    """The signals of all fitted runs with a candidate in the model, at some points.

    Args:
        candidate: an effect or a sensor fault.
        points: coordinates (points, n) of its unknowns.
        known: the fit problem of the model without it.
        values: values (SI) of the unknowns of this problem, by name.
        steps_per_sample: time steps per sample.
        without: the signals without the candidate, which a sensor fault changes afterwards.
    """
    runs = known.fitted_runs
    if candidate.signal is not None:
        unknowns = candidate.unknowns(known.campaign)
        for x in points:
            own = {u.name.removeprefix(candidate.prefix): u.value(v) for u, v in zip(unknowns, x, strict=True)}
            faulty = Instruments({candidate.signal: (candidate.kind(**own),)})
            yield [faulty.record(run.time, of, None, (), ())[0] for run, of in zip(runs, without, strict=True)]
        return
    problem, run_indices = with_candidates(known, [candidate]), tuple(range(len(runs)))
    x = start_coordinates(problem, values)[: -points.shape[1] or None]
    cases = [EvaluationPoint(np.concatenate([x, own]), run_indices) for own in points]
    model = MeasurementModel(problem.campaign, problem.machine, problem.unknowns, runs, problem.instruments)
    for found in model.predict(cases, steps_per_sample, with_sensitivities=False):
        yield [found[r].values for r in run_indices]


def signature_table(
    fit: Fit, candidates: Sequence[Candidate], report: Callable[[str], None], with_free_terms: bool = True
) -> SignatureTable:
    """Simulate the signatures of all causes at a fit.

    Args:
        fit: the fit of a model without any of them.
        candidates: effects and sensor faults.
        report: called with a sentence on the progress.
        with_free_terms: whether free terms are causes too, and give the background.
    """
    simulator = SignatureSimulator(fit)
    report("signatures of all effects and sensor faults")
    named, rows_of_named = _named(simulator, candidates)
    found = []
    every_free = (*curves_with_slopes(fit, report), *memories_with_slopes(fit, report)) if with_free_terms else ()
    for term, slopes in every_free:
        rows = simulator.whitened(slopes).T
        if (np.abs(rows) < LARGEST_CHANGE).all() and np.abs(rows).max() > 0.0:
            found.append(FreeSlopes(term, rows.astype(np.float32), rows @ rows.T))
    samples = int(simulator.ends[-1])
    found, rows_of_free = _in_one_array(found, samples)
    return SignatureTable(named, found, _background(found, samples), simulator.ends, (rows_of_named, rows_of_free))


def _named(
    simulator: SignatureSimulator, candidates: Sequence[Candidate]
) -> tuple[tuple[Signatures, ...], np.ndarray]:
    """The signatures of those candidates that change something, and all their rows."""
    every = (simulator.signatures(candidate) for candidate in candidates)
    return _in_one_array([found for found in every if len(found.rows)], int(simulator.ends[-1]))


def _in_one_array(causes: Sequence[Cause], samples: int) -> tuple[tuple[Cause, ...], np.ndarray]:
    """The causes with their rows as views of one array of all rows, and that."""
    every = np.concatenate([np.zeros((0, samples), np.float32), *(of.rows for of in causes)])
    views = np.split(every, np.cumsum([len(of.rows) for of in causes]))
    return tuple(dataclasses.replace(of, rows=rows) for of, rows in zip(causes, views, strict=False)), every


def _background(free: Sequence[FreeSlopes], samples: int) -> np.ndarray:
    """The directions of the background (m, g), whitened."""
    shapes = []
    for of in free:
        if not isinstance(of.term, CurveCandidate):
            continue
        columns = of.rows[:SMOOTHEST].T
        lengths = np.linalg.norm(columns, axis=0)
        shapes.append(columns[:, lengths > 0.0] / lengths[lengths > 0.0])
    if not shapes:  # a rig of one's own without slots
        return np.zeros((samples, 0))
    stack = np.concatenate(shapes, axis=1)
    values, vectors = np.linalg.eigh(stack.T @ stack)
    kept = np.argsort(-values)[:MAX_DIRECTIONS]
    return stack @ vectors[:, kept[values[kept] > MIN_EIGENVALUE * values.max()]]


def _size_exponent(unknowns: Sequence[UnknownParameter], found: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """The power of the first unknown with which a signature grows, from signatures at grid points; see `Signatures`."""
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
        exponent: power of the first unknown with which the signature grows, see `Signatures`.
    """
    out = np.array(x, float)
    if unknowns:
        value = scale ** (1.0 / exponent) * float(unknowns[0].value(x[0]))
        out[0] = np.clip(unknowns[0].coordinate(value), *unknowns[0].bounds())
    return out
