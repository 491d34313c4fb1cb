"""The search for the sets of effects that explain the measurements best, with a weight for each set.

A set holds effects and sensor faults, and at most one free curve for what no list has. Its weight is its prior times a
Student distribution of its misfit X (`LinearModel.misfit`) with α freedoms,

    ln w = Σ ln prior odds − (α/2) ln(1 + 2 X/α)

At the noise (X ≪ α) that is the usual evidence. Far above it only the ratio of misfits counts, because the error of a
model is a few smooth functions, not one error for each sample: half the misfit is worth (α/2) ln 2.

The search begins with the empty set. Each round predicts every addition to the best sets, and to the best one without
one of its members (an exchange), from signatures; refits the most promising ones; and drops members of the best set in
turn. It ends where nothing is promising.

Every fit has two kinds of start: the parameters of the set from which it comes, and those of a robust fit, in which
the background may take what it can (`Floor`), so that they are not distorted by what the model lacks.

Source: Student distribution in place of a normal one for model error: Miller and Dunson, J. Am. Stat. Assoc. 114 (2019)
1113 (coarsened posterior); average over sets: Madigan and Raftery, J. Am. Stat. Assoc. 89 (1994) 1535.
"""

import collections
import copy
import dataclasses
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
from edhas_jax.diagnosis.calibration.symmetric_matrices import inverse_factor
from edhas_jax.diagnosis.search.candidates import Candidate, with_candidates
from edhas_jax.diagnosis.search.checkpoint import Checkpoint
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.search.law_deviation import law_deviation_columns
from edhas_jax.diagnosis.search.screening import MAX_SCALE, MIN_SCALE, Signatures, with_scaled_size
from edhas_jax.diagnosis.sets.linear_model import Floor, FlooredModel, LinearModel, floor_of
from edhas_jax.diagnosis.sets.signature_table import CurveSlopes, SignatureTable
from edhas_jax.diagnosis.workers import Workers
from edhas_jax.measurements.time_resolution import TimeResolution

FREEDOMS = 30.0  # α: a misfit that a law leaves has about as many free numbers as two or three curves
EXPECTED = 0.7  # named effects that a campaign hides on average, over all candidates together
UNKNOWN_ODDS = 0.15  # odds that it hides one that no list has, over all places together
MOST_NAMED = 3  # of a set, beside at most one free curve
EXPANDED, REFITTED, MAX_ROUNDS = 3, 4, 6  # sets whose additions are predicted in a round, fits in a round, rounds
WINDOW = 3.0  # nats below the best set, within which a predicted set is fitted and a fitted one competes (1 : 20)
KEPT_PROMISE = 0.5  # of a predicted gain: a fit that gains less probably ended elsewhere; another start is tried
FIT_STEPS, ROBUST_STEPS = 15, 8  # maximum numbers of Levenberg-Marquardt steps
SIZES = np.concatenate([[0.0], 10.0 ** np.arange(0.0, 4.01, 0.5)])  # of the background that are compared
MIN_INDEPENDENT = 1e-9  # share of a signature that the columns of a set leave, below which it is rounding errors

Report = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class Start:
    """Where a fit begins (n,), and the floor of a robust fit that comes first."""

    x: np.ndarray
    floor: Floor = Floor()


@dataclasses.dataclass
class Move:
    """The addition of a cause to a set: coordinates at which its fit may start, and the predicted log weight."""

    to: "FittedSet"
    added: Candidate
    starts: tuple[np.ndarray, ...]
    predicted: float

    @property
    def key(self) -> frozenset[str]:
        """The names in the new set."""
        return self.to.key | {self.added.name}


@dataclasses.dataclass
class FittedSet:
    """A set of causes with its fit.

    Args:
        members: effects, sensor faults and free curves.
        evaluated: the fit.
        model: the linear model around it.
        floor: the floor of robust fits.
        log_weight: logarithm of its weight.
        untried: further starts of its fit.
        moves: predicted additions; None before they are predicted.
    """

    members: tuple[Candidate, ...]
    evaluated: EvaluatedFit
    model: LinearModel
    floor: Floor
    log_weight: float
    untried: list[Start] = dataclasses.field(default_factory=list)
    moves: list[Move] | None = None

    @property
    def key(self) -> frozenset[str]:
        """The names of its members."""
        return frozenset(candidate.name for candidate in self.members)

    def __str__(self) -> str:
        return " + ".join(sorted(candidate.title for candidate in self.members)) or "nothing"


class Job(NamedTuple):
    """The fit of a set: its members, where it may start, and the log weight from which no further start is tried."""

    members: tuple[Candidate, ...]
    starts: Sequence[Start]
    promised: float = math.inf

    @property
    def key(self) -> frozenset[str]:
        """The names of the members."""
        return frozenset(candidate.name for candidate in self.members)


def log_student(misfit: float) -> float:
    """The logarithm of the weight of a misfit [nats]; see the module."""
    return -misfit if misfit < 0.0 else -0.5 * FREEDOMS * math.log1p(2.0 * misfit / FREEDOMS)


class SetSearch:
    """The search over sets of causes.

    Args:
        calibrated: the fit of the model without any of them.
        table: the signatures of all causes there.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        checkpoint: keeps the coordinates of finished fits; None keeps none.
        prefix: of their names in it.
        workers: processes for the fits of a round; None for this one.
    """

    def __init__(
        self, calibrated: EvaluatedFit, table: SignatureTable, resolution: TimeResolution, report: Report,
        checkpoint: Checkpoint | None = None, prefix: str = "", workers: Workers | None = None,
    ):  # fmt: skip
        self._base, self._table, self._resolution, self._report = calibrated, table, resolution, report
        self._checkpoint, self._prefix, self._workers = checkpoint or Checkpoint(), prefix, workers
        self._fits_of: collections.Counter[frozenset[str]] = collections.Counter()  # how often each set was fitted
        odds = EXPECTED / max(len(table.candidates), 1)
        self._log_named, self._log_free = math.log(odds), math.log(UNKNOWN_ODDS / max(len(table.curves), 1))
        self.sets: dict[frozenset[str], FittedSet] = {}
        self._failed: set[frozenset[str]] = set()
        empty = self._weighed((), calibrated, LinearModel(calibrated.fit, None, table.background))
        self._undistorted: Mapping[str, float] = {}
        if empty.floor.size > 0.0:
            try:
                start = np.zeros(len(calibrated.fit.x))
                robust = fit_coarse(self._problem((), empty.floor), start, resolution.coarse, FIT_STEPS)
                self._undistorted = robust.fit.values
                again = self._fitted((), Start(robust.fit.x))
                empty = again if again is not None and again.log_weight > empty.log_weight else empty
            except FitError:
                pass  # the model fails near the prior means: then only the calibrated parameters serve as a start
        self.sets[empty.key] = empty

    def run(self) -> list[FittedSet]:
        """Search, and return all sets that were fitted, the one with the largest weight first."""
        for _ in range(MAX_ROUNDS):
            best = self.ranked()[0]
            moves, dropped = self._moves(best), self._smaller(best)
            if not moves and not dropped:
                break
            jobs = [self._job(move) for move in moves]
            jobs += [Job(members, self._starts(members, best, {})) for members in dropped]
            for job, fitted in zip(jobs, self._fits(jobs), strict=True):
                self._add(fitted, job.key)
            self._let_compete()
            self._report(f"best so far: {self.ranked()[0]}")
        return self.ranked()

    def ranked(self) -> list[FittedSet]:
        """All sets that were fitted, the one with the largest weight first."""
        return sorted(self.sets.values(), key=lambda of: -of.log_weight)

    def _add(self, found: FittedSet | None, key: frozenset[str]) -> None:
        if found is None:
            self._failed.add(key)
        else:
            self.sets[key] = found

    def _moves(self, best: FittedSet) -> list[Move]:
        """The additions that are fitted next, of which at most one is a free curve."""
        smaller = [self.sets.get(best.key - {c.name}) for c in best.members]
        for of in [*self.ranked()[:EXPANDED], *(of for of in smaller if of is not None)]:
            if of.moves is None:
                of.moves = self._predicted_moves(of)
        known, found = set(self.sets) | self._failed, {}
        for move in sorted((m for of in self.sets.values() for m in of.moves or ()), key=lambda m: -m.predicted):
            # a further effect has to promise something; another first one, or an exchange, only to come near
            least = best.log_weight - (0.0 if move.to is best and best.members else WINDOW)
            if move.predicted > least and move.key not in known and self._is_allowed(move):
                found.setdefault(move.key, move)
        curves = [move for move in found.values() if isinstance(move.added, FreeTerm)]
        return [m for m in found.values() if not isinstance(m.added, FreeTerm) or m is curves[0]][:REFITTED]

    @staticmethod
    def _is_allowed(move: Move) -> bool:
        free = sum(isinstance(c, FreeTerm) for c in (*move.to.members, move.added))
        return free <= 1 and len(move.key) - free <= MOST_NAMED

    def _smaller(self, best: FittedSet) -> list[tuple[Candidate, ...]]:
        """The best set without one of its members, where that has not been fitted yet."""
        known = set(self.sets) | self._failed
        found = [tuple(c for c in best.members if c is not gone) for gone in best.members]
        return [members for members in found if frozenset(c.name for c in members) not in known]

    def _let_compete(self) -> None:
        """Fit those sets from their other starts too that compete with the best one."""
        while True:
            ranked = self.ranked()
            near = [of for of in ranked if of.log_weight > ranked[0].log_weight - WINDOW]
            waiting = next((of for of in near if of.untried), None)
            if waiting is None or len(near) < 2:
                return
            start, waiting.untried = waiting.untried[0], waiting.untried[1:]
            (found,) = self._fits([Job(waiting.members, [start])])
            if found is not None and found.log_weight > waiting.log_weight:
                found.untried = waiting.untried
                self.sets[found.key] = found

    def _fits(self, jobs: Sequence[Job]) -> Iterator[FittedSet | None]:
        """The best fit of each of several sets, None where the model fails; kept ones are only evaluated again."""
        stages = [self._stage(job) for job in jobs]
        kept = [self._checkpoint.recall(stage) for stage in stages]
        waiting = [job for job, known in zip(jobs, kept, strict=True) if known is None]
        at_once = None
        if self._workers is not None and waiting:
            self._report(f"on the workers: {', '.join(' + '.join(sorted(job.key)) for job in waiting)}")
            at_once = iter(self._workers.map(_best_fit, [(self._for_workers(), job) for job in waiting]))
        for job, stage, known in zip(jobs, stages, kept, strict=True):
            if known is not None:
                tried, arrays = known
                found = self._fitted(job.members, Start(arrays["x"]), 0) if arrays else None
                if found is not None:
                    found.untried = list(job.starts[tried:])
                yield found
                continue
            if at_once is None:
                self._report(f"fitting {' + '.join(sorted(job.key)) or 'nothing'}")
            found = self.best_fit(job) if at_once is None else next(at_once)
            tried = 0 if found is None else len(job.starts) - len(found.untried)
            self._checkpoint.keep(stage, tried, {} if found is None else {"x": found.evaluated.fit.x})
            yield found

    def _stage(self, job: Job) -> str:
        """The name of a fit in the checkpoint, from the names of the members and how often they were fitted before."""
        self._fits_of[job.key] += 1
        names = hashlib.sha256(" + ".join(sorted(job.key)).encode()).hexdigest()[:16]
        return f"{self._prefix}set_{names}_{self._fits_of[job.key]}"

    def _for_workers(self) -> "SetSearch":
        """The search with what a fit needs, to be sent to another process."""
        small = copy.copy(self)
        small.sets, small._table = {}, dataclasses.replace(self._table, candidates=())
        small._checkpoint, small._workers, small._report = Checkpoint(), None, None
        return small

    def _job(self, move: Move) -> Job:
        members, of = (*move.to.members, move.added), move.to
        gain = move.predicted - of.log_weight
        promised = of.log_weight + KEPT_PROMISE * gain if gain > 0.0 else -math.inf
        unknowns = move.added.unknowns(self._base.fit.problem.campaign)
        first, *others = [{u.name: u.value(v) for u, v in zip(unknowns, x, strict=True)} for x in move.starts]
        starts = self._starts(members, of, first)
        starts += [self._robust_start(members, of, own) for own in others]
        return Job(members, starts, promised)

    def _starts(self, members: tuple[Candidate, ...], of: FittedSet, own: Mapping[str, float]) -> list[Start]:
        """The two starts of a fit: at the values of a known set, and with the undistorted ones of the machine.

        Args:
            members: the members of the new set.
            of: the known set.
            own: values (SI) of the unknowns that it has not.
        """
        at_known = start_coordinates(self._problem(members), {**of.evaluated.fit.values, **own})
        return [Start(at_known), self._robust_start(members, of, own)]

    def _robust_start(self, members: tuple[Candidate, ...], of: FittedSet, own: Mapping[str, float]) -> Start:
        values = {**of.evaluated.fit.values, **self._undistorted, **own}
        return Start(start_coordinates(self._problem(members), values), of.floor)

    def best_fit(self, job: Job) -> FittedSet | None:
        """The best of fits from some starts, further ones of which wait where it is as good as promised."""
        best = None
        for k, start in enumerate(job.starts):
            found = self._fitted(job.members, start)
            if found is not None and (best is None or found.log_weight > best.log_weight):
                best = found
            if best is not None and best.log_weight >= job.promised:
                best.untried = list(job.starts[k + 1 :])
                break
        return best

    def _fitted(self, members: tuple[Candidate, ...], start: Start, steps: int = FIT_STEPS) -> FittedSet | None:
        """The fit of a set; None where the model fails."""
        x, coarse = start.x, self._resolution.coarse
        try:
            if start.floor.size > 0.0:
                x = fit_coarse(self._problem(members, start.floor), x, coarse, ROBUST_STEPS).fit.x
            evaluated = fit_coarse(self._problem(members), x, coarse, steps)
        except FitError:
            return None
        named = [c for c in members if not isinstance(c, FreeTerm)]
        laws = law_deviation_columns(evaluated.fit, named) if named else None
        model = LinearModel(evaluated.fit, laws, self._table.background)
        return self._weighed(members, evaluated, model) if model.is_finite else None

    def _weighed(self, members: tuple[Candidate, ...], evaluated: EvaluatedFit, model: LinearModel) -> FittedSet:
        log_weight = log_student(model.at(Floor()).misfit) + sum(map(self._log_prior, members))
        return FittedSet(members, evaluated, model, floor_of(model, self._table.ends, SIZES), log_weight)

    def _log_prior(self, candidate: Candidate) -> float:
        return self._log_free if isinstance(candidate, FreeTerm) else self._log_named

    def _problem(self, members: Sequence[Candidate], floor: Floor = Floor()) -> FitProblem:
        """The fit problem of a set; with a floor, that of a robust fit."""
        problem, background = with_candidates(self._base.fit.problem, members), None
        if floor.size > 0.0:
            background = {
                run.name: {n: floor.size * v for n, v in columns.items()}
                for run, columns in zip(problem.model().runs, self._table.background_columns, strict=True)
            }
        return dataclasses.replace(problem, background=background, noise_factor=floor.noise)

    def _predicted_moves(self, of: FittedSet) -> list[Move]:
        """The additions to a set, their log weights predicted from signatures.

        A signature predicts the fall of what is left without a floor, and with that of robust fits, where what the
        background can do counts little. The larger relative fall is taken.
        """
        with_floors = [of.model.at(floor) for floor in ([Floor(), of.floor] if of.floor.size > 0.0 else [Floor()])]
        moves = [self._named_move(of, found, with_floors) for found in self._table.candidates]
        moves += [self._curve_move(of, slopes, with_floors) for slopes in self._table.curves]
        return [move for move in moves if move.added.name not in of.key]

    def _named_move(self, of: FittedSet, signatures: Signatures, with_floors: Sequence[FlooredModel]) -> Move:
        rows, best = signatures.rows, (-math.inf, 0, 0.0)
        squares, products = np.einsum("km,km->k", rows, rows, dtype=float), of.model.products(rows)
        for model in with_floors:
            inner, overlap = model.reduced(products, squares)
            usable = inner > MIN_INDEPENDENT * squares / model.floor.noise**2
            scale = np.where(usable, np.clip(overlap / np.where(usable, inner, 1.0), 0.0, MAX_SCALE), 0.0)
            falls = scale * (overlap - 0.5 * scale * inner)
            k = int(np.argmax(falls))
            best = max(best, (_gain(model, falls[k], 0.0), k, float(scale[k])))
        gain, k, scale = best
        point, unknowns = signatures.points[k], signatures.candidate.unknowns(self._base.fit.problem.campaign)
        x = with_scaled_size(unknowns, point, max(scale, MIN_SCALE), signatures.exponent)
        return Move(of, signatures.candidate, (x, point), of.log_weight + gain + self._log_named)

    def _curve_move(self, of: FittedSet, slopes: CurveSlopes, with_floors: Sequence[FlooredModel]) -> Move:
        products, found = of.model.products(slopes.rows), []
        for model in with_floors:
            inner, overlap = model.reduced(products, slopes.gram)
            factor, log_information = inverse_factor(inner + np.eye(len(inner)))
            half = factor.T @ overlap
            gain = _gain(model, 0.5 * float(half @ half), 0.5 * log_information)
            found.append((gain, tuple(factor @ half)))
        gain, x = max(found)
        return Move(of, slopes.curve, (np.array(x),), of.log_weight + gain + self._log_free)


def _best_fit(search: SetSearch, job: Job) -> FittedSet | None:
    return search.best_fit(job)


def _gain(model: FlooredModel, fall: float, cost: float) -> float:
    """The gain of log weight [nats] by a fall of the misfit in units of a floor, less what the new numbers cost."""
    misfit = max(model.misfit - model.floor.noise**2 * fall, 0.0) + cost
    return log_student(misfit) - log_student(model.misfit)
