"""The search for the sets of effects that explain the measurements best, with a weight for each set.

A set holds effects and sensor faults, and at most one free term for what no list has. It is weighed by its misfit, see
`weight`.

The search begins with the empty set. Each round predicts every addition to the best sets, and to the best one without
one of its members (an exchange), from signatures, which are simulated again beside each best set; refits the most
promising ones; and drops members of the best set in turn. It ends where nothing is promising, or a round finds no
better set: above the noise two rounds, or three where nothing has been found yet.

A fit begins at the parameters of the set from which it comes. Where that leaves much, and the fit gains less than it
promised, growing parts of the runs are fitted, because the cost of whole runs then has many minima.

Source: average over sets: Madigan and Raftery, J. Am. Stat. Assoc. 89 (1994) 1535.
"""

import collections
import copy
import dataclasses
import hashlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import USUAL_COORDINATE, Candidate, FreeTerm, with_candidates
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.candidates.law_deviation import DEVIATION_SHARE, law_at_nodes, law_deviation_columns, law_size
from edhas_jax.diagnosis.search.checkpoint import Checkpoint
from edhas_jax.diagnosis.search.finished_stage import BEST, CALIBRATED, stage_sentence
from edhas_jax.diagnosis.search.linear_model import Floor, FlooredModel, LinearModel, floor_of
from edhas_jax.diagnosis.search.signatures import (
    MAX_SCALE,
    MIN_SCALE,
    SMALL_SIZE,
    FreeSlopes,
    Signatures,
    SignatureTable,
    with_scaled_size,
)
from edhas_jax.diagnosis.search.weight import WEIGHT, Weighing, counts
from edhas_jax.diagnosis.search.workers import Workers
from edhas_jax.inference.fit.calibrated_model import PROGRESSIVE_EXCESS, Report
from edhas_jax.inference.fit.evaluated_fit import (
    COST_TOLERANCE,
    EvaluatedFit,
    fit_coarse,
    start_coordinates,
    with_own_solver_error,
)
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem
from edhas_jax.inference.fit.local_minima import fit_progressively
from edhas_jax.inference.likelihood.symmetric_matrices import inverse_factor
from edhas_jax.measurements.time_resolution import TimeResolution

MOST_EFFECTS = 3  # of a set, beside faults of sensors and at most one free term
EXPANDED, REFITTED, MAX_ROUNDS = 3, 4, 6  # sets whose additions are predicted in a round, fits in a round, rounds
LEAST_ADDITIONS = 2  # to the best set, fitted in a round above the noise even if predicted to be a little too weak
WINDOW = 3.0  # nats below the best set, within which a predicted set is fitted and a fitted one competes (1 : 20)
WORTH_A_FIT = 1.0  # nats of log weight that another start could gain at most, from which it is tried
LAWS_TRIED = 3  # effects that are fitted in place of a free term at their part of the machine, as it may be their law
PREDICTION_ERROR = 0.5 * WEIGHT.freedoms  # nats: near the noise a fit may leave a misfit e times the predicted one
KEPT_PROMISE = 0.5  # of a predicted gain: a fit that gains less probably ended elsewhere; another start is tried
FIT_STEPS = 15  # maximum number of Levenberg-Marquardt steps of a fit, and of each part of one on growing parts
CHECKED_STEPS, LEAST_FALL = 3, 0.01  # of these steps a fall by this share of the misfit: 0.1 nats of weight at most
SIZES = np.concatenate([[0.0], 10.0 ** np.arange(0.0, 4.01, 0.5)])  # of the background that are compared
MIN_INDEPENDENT = 1e-6  # share of a signature that the columns of a set leave, below which it is rounding errors


def key_of(members: Sequence[Candidate]) -> frozenset[str]:
    """The names of the members of a set, by which sets are told apart."""
    return frozenset(candidate.name for candidate in members)


@dataclasses.dataclass(frozen=True)
class Start:
    """Where a fit begins (n,), of the whole runs or, from there and from the prior means, of growing parts of them.

    Args:
        x: coordinates of all unknowns.
        scanned: number of the last ones that are scanned before growing parts are fitted; 0 for whole runs.
    """

    x: np.ndarray
    scanned: int = 0


@dataclasses.dataclass
class Move:
    """The addition of a cause to a set.

    Args:
        to: the set.
        added: the cause.
        start: coordinates at which its fit begins, of its first unknowns; the others begin at their prior means.
        small: coordinates at which it is hardly felt.
        fall: predicted fall of the misfit [nats].
    """

    to: "FittedSet"
    added: Candidate
    start: np.ndarray
    small: np.ndarray
    fall: float

    @property
    def key(self) -> frozenset[str]:
        """The names in the new set."""
        return self.to.key | {self.added.name}


@dataclasses.dataclass
class FittedSet:
    """A set of causes with its fit.

    Args:
        members: effects, sensor faults and free terms.
        evaluated: the fit.
        model: the linear model around it.
        misfit: see `FlooredModel`, without a floor.
        numbers: the same.
        excess: the same.
        samples: number of samples of the fit.
        fall_by_laws: fall of the misfit by deviations of its laws [nats]; infinite where these are not known.
        log_weight: logarithm of its weight [nats]; NaN before the search has ended.
        gain: rise of the log likelihood [nats] by that of its members that adds least, from the set without it.
        untried: further starts of its fit.
        moves: predicted additions; None before they are predicted.
    """

    members: tuple[Candidate, ...]
    evaluated: EvaluatedFit
    model: LinearModel
    misfit: float
    numbers: float
    excess: float
    samples: int
    fall_by_laws: float = math.inf
    log_weight: float = math.nan
    gain: float = math.inf
    untried: list[Start] = dataclasses.field(default_factory=list)
    moves: list[Move] | None = None

    @property
    def key(self) -> frozenset[str]:
        """The names of its members."""
        return key_of(self.members)

    def __str__(self) -> str:
        return " + ".join(sorted(candidate.title for candidate in self.members)) or "nothing"


class Job(NamedTuple):
    """The fit of a set.

    Args:
        members: its members.
        starts: where it may start.
        enough: misfit [nats] from which no further start is tried.
        small: the start that follows where that ends above `known`, the misfit of a smaller set; None for no such one.
        known: see `small`.
        move: the move that leads to it; None for another one.
    """

    members: tuple[Candidate, ...]
    starts: Sequence[Start]
    enough: float = -math.inf
    small: Start | None = None
    known: float = math.inf
    move: Move | None = None

    @property
    def key(self) -> frozenset[str]:
        """The names of the members."""
        return key_of(self.members)


class Scaled(NamedTuple):
    """A linear model with a floor that predicts falls of the misfit, and their conversion to a model without one.

    Args:
        model: the model.
        factor: fall without a floor over fall with it.
        most: largest fall without a floor [nats].
    """

    model: FlooredModel
    factor: float
    most: float

    def fall(self, of: float) -> float:
        """The fall of the misfit without a floor [nats], from that with the floor."""
        return min(self.factor * float(of), self.most)

    def fall_of_term(
        self, inner: np.ndarray, overlap: np.ndarray, error: float, wider: float
    ) -> tuple[float, np.ndarray, float]:
        """The fall of the misfit by a free term less what its numbers cost [nats], its coordinates, and `wider`.

        Args:
            inner: products of its rows, see `FlooredModel.reduced`.
            overlap: the same with the residual.
            error: their rounding errors.
            wider: factor on the standard deviations of its priors.
        """
        factor, log_information = inverse_factor(wider**2 * inner + (1.0 + wider**2 * error) * np.eye(len(inner)))
        half = factor.T @ (wider * overlap)
        return self.fall(0.5 * half @ half) - 0.5 * log_information, factor @ half, wider


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
        self._checkpoint, self._prefix, self._workers = checkpoint or Checkpoint(), prefix, workers
        self._times: collections.Counter[frozenset[str]] = collections.Counter()  # how often each set was fitted
        self._base, self._resolution, self._report = calibrated, resolution, report
        self._background, self._ends = table.background, table.ends
        self._tables = {frozenset(): table}  # at the calibrated model, and at best sets that leave more than noise
        self.weight = Weighing(len(table.candidates), len(table.free), len(table.background))
        self.sets: dict[frozenset[str], FittedSet] = {}
        self._failed: set[frozenset[str]] = set()
        self._at_their_ends: list[Fit] = []  # fits that do not go on
        self._left_out: set[tuple[frozenset[str], str]] = set()  # sets with the members that were left out of them
        self._compared: set[tuple[frozenset[str], frozenset[str]]] = set()  # effects with curves in their place
        empty = self._weighed((), calibrated, LinearModel(calibrated.fit, None, self._background))
        self._add(empty, empty.key)

    def run(self, known: FittedSet | None = None) -> list[FittedSet]:
        """Search, and return all sets that were fitted, the one with the largest weight first.

        Args:
            known: the best set of another search on these runs; it is fitted first.
        """
        if known is not None and known.members:
            start = Start(start_coordinates(self._problem(known.members), known.evaluated.fit.values))
            for job, found in self._fits([Job(known.members, [start])]):
                self._add(found, job.key)
        without_success = 0
        for _ in range(MAX_ROUNDS):
            best = self.ranked()[0]
            self._simulate_beside(best)
            moves, dropped = self._moves(best), self._smaller(best)
            if not moves and not dropped:
                break
            jobs = [self._job(move) for move in moves]
            jobs += [Job(members, self._starts(members, best, {}, 0), best.misfit) for members in dropped]
            for job, found in self._fits(jobs):
                self._add(found, job.key)
            self._take_curves_as_laws()
            self._let_compete()
            self._go_on()
            former, best = best, self.ranked()[0]
            self._report(stage_sentence(f"{BEST}{best}" if best.members else CALIBRATED, best.evaluated))
            without_success = without_success + 1 if best.key == former.key else 0
            more_rounds = 0 if not best.excess > 0.0 else 1 if best.members else 2
            if without_success > more_rounds:
                break  # nothing better in a round; above the noise in two, or in three where nothing is found yet
        misfits = {key: of.misfit for key, of in self.sets.items()}
        for key, of in self.sets.items():
            of.log_weight, of.gain = self.weight.of(of), self.weight.gain(key, misfits)
        return self.ranked()

    def additions(self) -> list[Move]:
        """The additions of one cause to the model that has none; without them where that is not finite."""
        return [move for of in self.sets.values() if not of.members for move in self._predicted_moves(of)]

    def fit_of(self, move: Move) -> FittedSet | None:
        """The best fit of the set to which a move leads; None where the model fails."""
        return self.best_fit(self._job(move))

    def ranked(self) -> list[FittedSet]:
        """All sets that were fitted, the one with the largest weight first."""
        return sorted(self.sets.values(), key=lambda of: -self.weight.of(of))

    def _add(self, found: FittedSet | None, key: frozenset[str]) -> None:
        """Keep a fit of a set, unless a better one of the same set is known."""
        known = self.sets.get(key)
        if found is None and known is None:
            self._failed.add(key)
        elif found is not None and (known is None or found.misfit < known.misfit):
            self.sets[key] = found
            self.weight.note(found)

    def _simulate_beside(self, best: FittedSet) -> None:
        """Simulate the signatures beside the best set where that leaves more than noise."""
        if best.excess > 0.0 and best.key not in self._tables:
            self._report(f"signatures beside {best}")
            self._tables[best.key] = self._tables[frozenset()].at(best.evaluated.fit, best.key)
            for of in self.sets.values():  # those that hold it are predicted anew
                of.moves = None if of.key >= best.key else of.moves

    def _moves(self, best: FittedSet) -> list[Move]:
        """The additions that are fitted next; one free term at most, beside a curve next to a law."""
        for of in self._expanded(best):
            if of.moves is None:
                of.moves = self._predicted_moves(of)
        known, found, further = set(self.sets) | self._failed, {}, 0
        every = (move for of in self.sets.values() for move in of.moves or ())
        ranked = sorted(filter(self._is_allowed, every), key=lambda move: -self._predicted(move))
        for move in ranked:
            # a further effect has to promise something; another first one, or an exchange, only to come near
            least = self.weight.of(best) - (0.0 if move.to is best and best.members else WINDOW)
            # above the noise, some further effects are fitted even if their prediction is too low by its error
            if move.to is best and best.excess > 0.0 and further < LEAST_ADDITIONS:
                least -= PREDICTION_ERROR
            if self._predicted(move) > least and move.key not in known:
                found.setdefault(move.key, move)
                further += move.to is best
        curves = [move for move in found.values() if isinstance(move.added, FreeTerm)]
        chosen = [m for m in found.values() if not isinstance(m.added, FreeTerm) or m is curves[0]][:REFITTED]
        laws = [move for move in ranked if self._may_be_law(move, best)][:LAWS_TRIED]
        laws += [move for move in ranked if self._is_curve_beside_law(move, best, chosen)][:1]
        return chosen + [move for move in laws if move.key not in known and move not in chosen]

    def _expanded(self, best: FittedSet) -> list[FittedSet]:
        """The sets whose additions are predicted: the best ones, and the best one less each of its members."""
        smaller = [self.sets.get(best.key - {c.name}) for c in best.members]
        return [*self.ranked()[:EXPANDED], *(of for of in smaller if of is not None)]

    @staticmethod
    def _may_be_law(move: Move, best: FittedSet) -> bool:
        """Whether a move exchanges the free term of the best set for an effect at the same place.

        The curve may be the law of that effect, however little its signature at another size predicts.
        """
        free = next((c for c in best.members if isinstance(c, FreeTerm)), None)
        if free is None or isinstance(move.added, FreeTerm):
            return False
        return move.to.key == best.key - {free.name} and move.added.location == free.location

    @staticmethod
    def _is_curve_beside_law(move: Move, best: FittedSet, chosen: Sequence[Move]) -> bool:
        """Whether a move adds a curve at the place of an effect of the best set, whose law may deviate by it.

        Only where that set leaves more than noise, or another effect of the same place is about to be added.
        """
        places = {c.location for c in best.members if not isinstance(c, FreeTerm)}
        if move.to is not best or not isinstance(move.added, CurveCandidate) or move.added.location not in places:
            return False
        return best.excess > 0.0 or any(m.to is best and m.added.location == move.added.location for m in chosen)

    @staticmethod
    def _is_allowed(move: Move) -> bool:
        members = (*move.to.members, move.added)
        _, free = counts(members)
        return free <= 1 and sum(c.signal is None for c in members) - free <= MOST_EFFECTS

    def _smaller(self, best: FittedSet) -> list[tuple[Candidate, ...]]:
        """The best set without one of its members, which is fitted from there once, as another fit may end elsewhere.

        Not where it has been fitted already and is far worse.
        """
        found = []
        for gone in best.members:
            members = tuple(c for c in best.members if c is not gone)
            known, pair = self.sets.get(key_of(members)), (best.key, gone.name)
            is_far = known is not None and self.weight.of(known) < self.weight.of(best) - PREDICTION_ERROR
            if not is_far and pair not in self._left_out and key_of(members) not in self._failed:
                self._left_out.add(pair)
                found.append(members)
        return found

    def _take_curves_as_laws(self) -> None:
        """Weigh effects whose law may be, or deviate by, a free curve that was fitted in their place or beside them."""
        curves = [(of, c) for of in self.ranked()[:EXPANDED] for c in of.members if isinstance(c, CurveCandidate)]
        for by_curve, curve in curves:
            others = by_curve.key - {curve.name}
            for of in [of for of in self.sets.values() if of.key >= others and len(of.key) <= len(by_curve.key)]:
                pair = of.key, by_curve.key
                effects = [c for c in of.members if of.key == others or c.name not in others]
                effects = [c for c in effects if not isinstance(c, FreeTerm) and c.location == curve.location]
                if pair in self._compared or not effects:
                    continue
                self._compared.add(pair)
                for effect in effects:
                    self._add(self._with_curve_as_law(of, effect, by_curve, curve), of.key)

    def _with_curve_as_law(
        self, of: FittedSet, effect: Candidate, by_curve: FittedSet, curve: CurveCandidate
    ) -> FittedSet | None:
        """A set with the misfit that it has where a free curve is the law of an effect; None where it cannot be that.

        The fit with the curve, but with another prior of its values, is the model with the effect and a law that
        deviates from it: around the law of the library where the curve is in the place of the effect, around zero where
        it is beside it.

        Args:
            of: the set with the effect.
            effect: the effect.
            by_curve: the same set with the curve in its place, or beside it.
            curve: the curve.
        """
        is_beside, own = effect.name in by_curve.key, 0.0
        if is_beside:
            mean, size = np.zeros(len(curve.coefficient_names)), law_size(by_curve.evaluated.fit, effect, curve.place)
        elif (law := law_at_nodes(of.evaluated.fit, effect, curve)) is not None:
            mean, size = curve.nearest((law[0] - curve.place.neutral) / curve.spread), law[1]
        else:
            return None
        if size is None:
            return None
        unknowns = by_curve.evaluated.fit.problem.unknowns
        places = np.array([k for k, u in enumerate(unknowns) if u.name in curve.coefficient_names])
        spread = np.full(len(places), DEVIATION_SHARE * size / curve.spread)
        found = self._weighed(of.members, of.evaluated, by_curve.model.with_prior(places, mean, spread))
        if not is_beside:  # the parameters of the effect are no unknowns of that fit
            own = 0.5 * sum(x * x for x in effect.own_coordinates(of.evaluated.fit).values())
        misfit = found.misfit + own
        fall = of.fall_by_laws + max(of.misfit - misfit, 0.0)
        return dataclasses.replace(found, misfit=misfit, numbers=found.numbers + own, fall_by_laws=fall)

    def _let_compete(self) -> None:
        """Fit those sets from their other starts too that compete with the best one."""
        while True:
            ranked = self.ranked()
            near = [of for of in ranked if self.weight.of(of) > self.weight.of(ranked[0]) - WINDOW]
            waiting = next((of for of in near if of.untried and self._may_gain(of)), None)
            if waiting is None or len(near) < 2:
                return
            start, waiting.untried = waiting.untried[0], waiting.untried[1:]
            ((_, found),) = self._fits([Job(waiting.members, [start])])
            if found is not None:
                found.untried = waiting.untried
                self._add(found, found.key)

    def _may_gain(self, of: FittedSet) -> bool:
        """Whether the weight of a set would be clearly larger if a fit left no more than noise."""
        return self.weight.at(of.misfit - of.excess, *counts(of.members)) > self.weight.of(of) + WORTH_A_FIT

    def _go_on(self) -> None:
        """Fit the best set on from where its fit has ended before it had converged, as long as that lowers ½χ²."""
        while True:
            best = self.ranked()[0]
            fit = best.evaluated.fit
            is_at_its_end = fit.converged or any(fit is end for end in self._at_their_ends)
            if not best.members or is_at_its_end or not best.excess > 0.0:
                return
            ((_, found),) = self._fits([Job(best.members, [Start(fit.x)])])
            is_worse = found is None or not found.misfit < best.misfit
            if is_worse or not fit.cost - found.evaluated.fit.cost > LEAST_FALL * best.excess:
                self._at_their_ends.append(fit)
                return
            found.untried = best.untried
            self._add(found, found.key)

    def _fits(self, jobs: Sequence[Job]) -> Iterator[tuple[Job, FittedSet | None]]:
        """The best fit of each of several sets, None where the model fails; kept ones are only evaluated again.

        Moves that promise too little when it is their turn are left out.
        """
        stages = [self._stage(job) for job in jobs]
        kept = [self._checkpoint.recall(stage) for stage in stages]
        waiting, at_once = [k for k, known in enumerate(kept) if known is None], {}
        if self._workers is not None and waiting:
            self._report(f"on the workers: {', '.join(' + '.join(sorted(jobs[k].key)) for k in waiting)}")
            calls = [(self._for_workers(), jobs[k]._replace(move=None)) for k in waiting]
            at_once = dict(zip(waiting, self._workers.map(_best_fit, calls), strict=True))
        for k, (job, known) in enumerate(zip(jobs, kept, strict=True)):
            if job.move is not None and not self._is_promising(job.move):
                continue
            if known is not None:
                tried, arrays = known
                found = self._fitted(job.members, Start(arrays["x"]), 0) if arrays else None
                if found is not None:
                    found.untried = list(job.starts[tried:])
                yield job, found
                continue
            if k not in at_once:
                self._report(f"fitting {' + '.join(sorted(job.key)) or 'nothing'}")
            found = at_once[k] if k in at_once else self.best_fit(job)
            tried = 0 if found is None else len(job.starts) - len(found.untried)
            self._checkpoint.keep(stages[k], tried, {} if found is None else {"x": found.evaluated.fit.x})
            yield job, found

    def _predicted(self, move: Move) -> float:
        """The log weight [nats] that is predicted of the set to which a move leads."""
        return self.weight.at(move.to.misfit - move.fall, *counts((*move.to.members, move.added)))

    def _is_promising(self, move: Move) -> bool:
        best = self.ranked()[0]
        if best.excess > 0.0 or self._may_be_law(move, best):
            return True
        return self._predicted(move) > self.weight.of(best) - PREDICTION_ERROR

    def _stage(self, job: Job) -> str:
        """The name of a fit in the checkpoint, from the names of the members and how often they were fitted before."""
        self._times[job.key] += 1
        names = hashlib.sha256(" + ".join(sorted(job.key)).encode()).hexdigest()[:16]
        return f"{self._prefix}set_{names}_{self._times[job.key]}"

    def _for_workers(self) -> "SetSearch":
        """The search with what a fit needs, to be sent to another process."""
        small, best = copy.copy(self), self.ranked()[0]
        slim = dataclasses.replace(best, evaluated=None, model=None, moves=None, untried=[])
        small.sets, small._tables = {best.key: slim}, {}
        small._checkpoint, small._workers, small._report = Checkpoint(), None, None
        return small

    def _job(self, move: Move) -> Job:
        members, of = (*move.to.members, move.added), move.to
        promised = of.misfit - KEPT_PROMISE * max(move.fall, 0.0)
        unknowns = move.added.unknowns(self._base.fit.problem.campaign)
        own, small = ({u.name: u.value(v) for u, v in zip(unknowns, x, strict=False)} for x in (move.start, move.small))
        (hardly_felt,) = self._starts(members, of, small, 0)
        starts = self._starts(members, of, own, len(unknowns))
        if isinstance(move.added, FreeTerm):  # far from the fit a linear prediction overshoots
            starts.insert(1, hardly_felt)
        return Job(members, starts, promised, hardly_felt, of.misfit, move)

    def _starts(
        self, members: tuple[Candidate, ...], of: FittedSet, own: Mapping[str, float], scanned: int
    ) -> list[Start]:
        """The starts of a fit: at the values of a known set, and, where that leaves much, on growing parts.

        Args:
            members: the members of the new set.
            of: the known set.
            own: values (SI) of the unknowns that it has not.
            scanned: see `Start`.
        """
        x = start_coordinates(self._problem(members), {**of.evaluated.fit.values, **own})
        has_minima = of.excess > PROGRESSIVE_EXCESS * self.weight.noise
        return [Start(x), Start(x, scanned)] if scanned and has_minima else [Start(x)]

    def best_fit(self, job: Job) -> FittedSet | None:
        """The best of fits from some starts, further ones of which wait where it is good enough."""
        best = None
        for k, start in enumerate(job.starts):
            found = self._fitted(job.members, start, known=best)
            if found is not None and (best is None or found.misfit < best.misfit):
                best = found
            if best is not None and (best.misfit <= job.enough or not best.excess > 0.0 or not self._may_lead(job)):
                best.untried = list(job.starts[k + 1 :])
                break
        has_failed = best is None or best.excess > 0.0 and best.misfit > job.known
        if job.small is not None and has_failed:  # begin where the cause is hardly felt
            again = self._fitted(job.members, job.small)
            best = again if again is not None and (best is None or again.misfit < best.misfit) else best
        return best

    def _may_lead(self, job: Job) -> bool:
        """Whether the set would compete with the best one if its fit kept what its move has promised."""
        if job.move is None:
            return True
        return self._predicted(job.move) > self.weight.of(self.ranked()[0]) - WINDOW

    def _fitted(
        self, members: tuple[Candidate, ...], start: Start, steps: int = FIT_STEPS, known: FittedSet | None = None
    ) -> FittedSet | None:
        """The fit of a set; None where the model fails, or a fit on growing parts does not improve on a known one."""
        problem, coarse = self._problem(members), self._resolution.coarse
        try:
            if not start.scanned:
                evaluated = fit_coarse(problem, start.x, coarse, steps, self._keep_on_rule())
            else:
                starts = np.array([np.zeros(len(start.x)), start.x])
                whole = None if known is None else known.evaluated
                evaluated = fit_progressively(problem, starts, start.scanned, coarse, FIT_STEPS, whole)
        except FitError:
            return None
        if evaluated is None:
            return None
        evaluated = with_own_solver_error(evaluated, self._resolution, steps, self._keep_on_rule())
        named = [c for c in members if not isinstance(c, FreeTerm)]
        laws = law_deviation_columns(evaluated.fit, named) if named else []
        if laws and any(columns.size for columns in laws[0].values()):
            return self._weighed(members, evaluated, LinearModel(evaluated.fit, laws, self._background))
        model = LinearModel(evaluated.fit, None, self._background)
        return self._weighed(members, evaluated, model, evaluated.cost)

    def _keep_on_rule(self) -> Callable[[int, float], bool]:
        """Whether a fit goes on, asked after every step with its number and ½χ²: not where that hardly falls."""
        costs: list[float] = []

        def keep_on(step: int, cost: float) -> bool:
            costs.append(cost)
            if len(costs) <= CHECKED_STEPS:
                return True
            return costs[-1 - CHECKED_STEPS] - cost > LEAST_FALL * max(cost - self.weight.noise, 0.0) + COST_TOLERANCE

        return keep_on

    def _weighed(
        self, members: tuple[Candidate, ...], evaluated: EvaluatedFit, model: LinearModel, reached: float = -math.inf
    ) -> FittedSet | None:
        """A fitted set with its misfit; None where the model or a derivative is not finite at a sample.

        Args:
            members: its members.
            evaluated: its fit.
            model: the linear model around that.
            reached: ½χ² with priors of the fit [nats]; what the linear model promises below it counts as left.
        """
        if not model.is_finite:
            return None
        at = model.at(Floor())
        missed = max(reached - (at.misfit - at.numbers + at.squares), 0.0)  # perhaps because of bounds
        has_laws = model.laws.stop > model.laws.start and not any(isinstance(c, FreeTerm) for c in members)
        return FittedSet(
            members, evaluated, model, at.misfit + missed, at.numbers, at.excess + missed, model.samples,
            at.fall_by_laws if has_laws else math.inf,
        )  # fmt: skip

    def _problem(self, members: Sequence[Candidate]) -> FitProblem:
        return with_candidates(self._base.fit.problem, members)

    def _predicted_moves(self, of: FittedSet) -> list[Move]:
        """The additions to a set, their log weights predicted from signatures.

        A signature predicts the fall of what is left without a floor, and with one, where what the background can do
        counts little. The larger relative fall is taken.
        """
        plain = of.model.at(Floor())
        scaled, floor = [Scaled(plain, 1.0, math.inf)], floor_of(of.model, self._ends, SIZES)
        if floor.size > 0.0:
            floored, most = of.model.at(floor), plain.excess + plain.squares
            factor = floor.noise**2 * most / (floored.excess + floored.squares)
            scaled.append(Scaled(floored, factor, most))
        table = self._tables[max((key for key in self._tables if key <= of.key), key=len)]
        causes, moves = (*table.candidates, *table.free), []
        products = np.concatenate([of.model.products(rows) for rows in table.rows])
        products = np.split(products, np.cumsum([len(cause.rows) for cause in causes])[:-1])
        for cause, own in zip(causes, products, strict=True):
            predict = self._named_move if isinstance(cause, Signatures) else self._free_move
            moves.append(predict(of, cause, own, scaled))
        return [move for move in moves if move.added.name not in of.key]

    def _named_move(
        self, of: FittedSet, signatures: Signatures, products: np.ndarray, scaled: Sequence[Scaled]
    ) -> Move:
        squares, best = signatures.squares, (-math.inf, 0, 0.0)
        for by in scaled:
            inner, overlap = by.model.reduced(products, squares)
            usable = inner > MIN_INDEPENDENT * squares / by.model.floor.noise**2
            scale = np.where(usable, np.clip(overlap / np.where(usable, inner, 1.0), 0.0, MAX_SCALE), 0.0)
            falls = scale * (overlap - 0.5 * scale * inner)
            k = int(np.argmax(falls))
            best = max(best, (by.fall(falls[k]), k, float(scale[k])))
        fall, k, scale = best
        point, unknowns = signatures.points[k], signatures.candidate.unknowns(self._base.fit.problem.campaign)
        x = with_scaled_size(unknowns, point, max(scale, MIN_SCALE), signatures.exponent)
        small = with_scaled_size(unknowns, point, SMALL_SIZE, signatures.exponent)
        return Move(of, signatures.candidate, x, small, fall)

    def _free_move(self, of: FittedSet, slopes: FreeSlopes, products: np.ndarray, scaled: Sequence[Scaled]) -> Move:
        best = None
        for by in scaled:
            inner, overlap = by.model.reduced(products, slopes.gram)
            error = MIN_INDEPENDENT * float(slopes.gram.diagonal().max()) / by.model.floor.noise**2
            gain, x, wider = by.fall_of_term(inner, overlap, error, 1.0)
            size = float(np.abs(x).max())
            if size > USUAL_COORDINATE:  # as wide as the data demand
                gain, x, wider = by.fall_of_term(inner, overlap, error, size / USUAL_COORDINATE)
            if best is None or gain > best[0]:
                best = gain, x, wider
        gain, x, wider = best
        term = dataclasses.replace(slopes.term, spread=wider * slopes.term.spread)
        return Move(of, term, x, 0.0 * x, gain)


def _best_fit(search: SetSearch, job: Job) -> FittedSet | None:
    return search.best_fit(job)
