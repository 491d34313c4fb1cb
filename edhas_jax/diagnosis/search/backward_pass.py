"""The backward pass: each accepted candidate is taken out again, everything refitted, and its loss compared.

A candidate that was accepted first may stand in for others that came later, and a later one may only fit what the law
of an earlier one does not. A member stays if the model without it, refitted from the values of the model with it,
leaves much more than the model with it.
"""

import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem, with_candidates
from edhas_jax.diagnosis.search.decision_rules import (
    LAW_ERROR_SHARE,
    least_strength,
    leaves_clearly_less,
    remaining,
    scatter_of_fits,
    strength,
)
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.free_law import MIN_LAW_STRENGTH, MIN_MOUNTED_STRENGTH
from edhas_jax.diagnosis.search.law_deviation import LawDeviation, deviation_cost, law_deviation_columns
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.result import MemberTest, Rejected, Round, accepted_trials, mounted_candidates
from edhas_jax.diagnosis.search.tightened_bench import with_tightened_bench
from edhas_jax.diagnosis.workers import Workers, fits_of
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution

REFIT_STEPS = 8  # maximum number of Levenberg-Marquardt steps of a refit without a member
LAW_ERROR_SHARE_AT_COMPONENT = 0.01  # as `LAW_ERROR_SHARE`, at the component on which the law acts


class TakenBack(NamedTuple):
    """The result of the backward pass: see `take_back`."""

    rounds: list[Round]
    members: list[MemberTest]
    rejected: tuple[Rejected, ...] = ()

    def after(self, earlier: "TakenBack") -> "TakenBack":
        """This result, with the candidates that an earlier backward pass removed among the rejected ones."""
        return self._replace(rejected=(*earlier.rejected, *self.rejected))


def take_back(
    rounds: Sequence[Round], resolution: TimeResolution, report: Callable[[str], None], workers: Workers | None = None
) -> TakenBack:
    """Take each accepted candidate out, and remove those without which the model leaves little more.

    Args:
        rounds: the rounds of the search, the last of which accepted nothing.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        workers: processes for the refits; None for this one.

    Returns:
        The rounds of the members that stay, the last of which accepts nothing, the test of each member, and what was
        taken out. The model of the first round is the best one without an effect that was found.
    """
    rounds, final = list(rounds), rounds[-1].baseline
    rejected: list[Rejected] = []
    while True:
        mounted = mounted_candidates(rounds)
        own = law_deviation_columns(final.fit, mounted) if mounted else None
        left = final.excess_with(own)
        explained = gains_with_own_law(rounds)
        tests, without_law_error = [], []
        jobs = [(final, others_of(mounted, candidate), rounds[0], resolution) for candidate in mounted]
        sentences = [f"the model without {candidate.name}" for candidate in mounted]
        without = fits_of(_refit, jobs, sentences, workers, report)
        for candidate, refitted in zip(mounted, without, strict=True):
            kept = [c for c in others_of(mounted, candidate) if c.id != _law_of(candidate)]
            deviations = law_deviation_columns(refitted.fit, kept) if kept else None
            before, after = refitted.excess_with(deviations), final.excess_with(deviations)
            penalty = (final.cost - refitted.cost) + (final.log_evidence - refitted.log_evidence)
            gain = before - after + penalty
            if _law_of(candidate) is None:
                gain = max(gain, before - left + penalty - deviation_cost(own) + deviation_cost(deviations))
            left_out_gain = float(np.sum(final.left_out - refitted.left_out))
            scatter = scatter_of_fits(final)
            floor = _law_error(candidate, mounted, explained) + scatter
            found = max(strength(gain, left, final.samples, floor), 0.0)
            tests.append(MemberTest(candidate, gain, left_out_gain, found))
            without_law_error.append(strength(gain, left, final.samples, scatter))
        least = least_strength(rounds[0].baseline)
        removable = [k for k, test in enumerate(tests) if not is_kept(test, least)]
        if not removable:
            return TakenBack(_with_best_start(rounds, mounted, without), _with_laws(tests, final), tuple(rejected))
        weakest = removable[0]
        doubtful = [k for k in removable if _law_of(mounted[k]) is None and without_law_error[k] >= least]
        if (curve := _needless_curve(mounted, without, removable, doubtful)) is not None:
            weakest = curve
        elif len(removable) > 1:  # members that stand in for each other
            left_implausible = {k: _implausible_count(others_of(mounted, mounted[k]), without[k]) for k in removable}
            weakest = min(removable, key=lambda k: _removal_order(tests[k], left_implausible[k], least))
        report(f"{mounted[weakest].name} is not needed")
        rejected += [Rejected(r, tests[weakest]) for r in _accepting(rounds, mounted[weakest])]
        final = without[weakest]
        rounds = _without(rounds, mounted[weakest], final)


def _with_best_start(
    rounds: Sequence[Round], mounted: Sequence[Candidate], without: Sequence[EvaluatedFit]
) -> list[Round]:
    """The rounds, the first one with the better of its model and of the refit without a single effect."""
    first, *others = rounds
    effects = [k for k, candidate in enumerate(mounted) if _law_of(candidate) is None]
    if len(effects) == 1 and without[effects[0]].cost < first.baseline.cost:
        first = dataclasses.replace(first, baseline=without[effects[0]])
    return [first, *others]


def _accepting(rounds: Sequence[Round], candidate: Candidate) -> list[Round]:
    """The round that accepted a candidate; none for the deviation of a law."""
    return [r for r in rounds if r.accepted is not None and r.accepted.candidate is candidate]


def _law_of(candidate: Candidate) -> str | None:
    """The id of the effect whose law a candidate changes; None for an effect or sensor fault."""
    return candidate.of if isinstance(candidate, LawDeviation) else None


def gains_with_own_law(rounds: Iterable[Round]) -> dict[str, float]:
    """Log-evidence gain [nats] of each accepted candidate in its round, with a law that may differ, by id."""
    return {trial.candidate.id: max(trial.own_law_gain, 0.0) for trial in accepted_trials(rounds)}


def _law_error(candidate: Candidate, mounted: Sequence[Candidate], explained: Mapping[str, float]) -> float:
    """Misfit [nats] that the curves of other effects' laws may leave, and that a candidate could therefore imitate.

    Args:
        candidate: the candidate; for the curve of a law it is 0.
        mounted: all candidates in the model.
        explained: log-evidence gain [nats] of each effect, by id.
    """
    if _law_of(candidate) is not None:
        return 0.0
    curves = {_law_of(c) for c in mounted} - {None, candidate.id}
    beside = {c.id for c in mounted if c.id in curves and c.location == candidate.location}
    shares = {of: LAW_ERROR_SHARE_AT_COMPONENT if of in beside else LAW_ERROR_SHARE for of in curves}
    return sum(share * explained[of] for of, share in shares.items())


def others_of(mounted: Sequence[Candidate], removed: Candidate) -> list[Candidate]:
    """The candidates that stay in the model when one is removed; with an effect, the curve of its law goes too."""
    return [c for c in mounted if c is not removed and _law_of(c) != removed.id]


def _implausible_count(members: Sequence[Candidate], model: EvaluatedFit) -> int:
    """The number of members with an implausible parameter in a model; curves have none."""
    return sum(bool(implausible_parameters(member, model.fit)) for member in members if _law_of(member) is None)


def _needless_curve(
    mounted: Sequence[Candidate], without: Sequence[EvaluatedFit], removable: Sequence[int], doubtful: Sequence[int]
) -> int | None:
    """The position in `mounted` of a curve that the model does not need; None if there is no such curve.

    The curve of a law also fits the influence of effects that the model does not have yet. An effect that is added
    later may then be too weak only because of the error allowed for the curve. The curve is not needed if the model
    with the effect and without the curve leaves much less misfit than that with the curve and without the effect.

    Args:
        mounted: all candidates in the model.
        without: the model without each of them.
        removable: positions of those that are too weak to stay.
        doubtful: of these, the effects that are too weak only because of the error allowed for curves.

    Returns:
        Of several such curves, the one without which the model leaves the least misfit.
    """
    found = [
        c for c in removable for e in doubtful
        if _law_of(mounted[c]) not in (None, mounted[e].id) and leaves_clearly_less(without[c], without[e])
    ]  # fmt: skip
    return min(found, key=lambda c: remaining(without[c].excess, without[c].samples), default=None)


def _margin(test: MemberTest, least: float) -> float:
    """The strength of a member over the least that keeps it, or that keeps the deviation of a law."""
    return test.strength / (least if _law_of(test.candidate) is None else MIN_MOUNTED_STRENGTH)


def is_kept(test: MemberTest, least: float) -> bool:
    """Whether a member, or the deviation of a law, is strong enough to stay; one of no finite strength is not."""
    return _margin(test, least) >= 1.0


def _removal_order(test: MemberTest, left_implausible: int, least: float) -> tuple[int, bool, float]:
    """A key that is smallest for the member to be removed first.

    Of members that stand in for each other, one without which all parameters are plausible is removed. Of an effect and
    a deviation of another effect's law it is the effect, because the deviation adds no name.
    """
    return left_implausible, _law_of(test.candidate) is not None, _margin(test, least)


def _with_laws(tests: Sequence[MemberTest], final: EvaluatedFit) -> list[MemberTest]:
    """The tests of effects and sensor faults, with the plausibility of their parameters and of the library's law."""
    laws = {_law_of(test.candidate): test for test in tests if _law_of(test.candidate) is not None}
    out = []
    for test in tests:
        candidate = test.candidate
        if _law_of(candidate) is not None:
            continue
        implausible = tuple(implausible_parameters(candidate, final.fit))
        if candidate.id in laws and candidate.signal is None:
            law = laws[candidate.id]
            gain, differs = law.gain, law.strength > MIN_LAW_STRENGTH
        else:
            columns = law_deviation_columns(final.fit, [candidate])
            after = final.excess_with(columns)
            gain = final.excess - after
            differs = strength(gain - deviation_cost(columns), after, final.samples) > MIN_LAW_STRENGTH
        out.append(test._replace(implausible=implausible, law_gain=gain, law_differs=differs))
    return out


def _refit(
    final: EvaluatedFit, others: Sequence[Candidate], first: Round, resolution: TimeResolution
) -> EvaluatedFit:
    """The model with some members, refitted from the final values; without any, the better of it and the calibrated.

    A single effect is refitted from the values of its trial in the `first` round as well, because the final ones may be
    far from those that it needs alone.
    """
    calibrated, effects = first.baseline, [c for c in others if _law_of(c) is None]
    alone = [t.evaluated for t in first.trials if [t.candidate] == effects and t.evaluated is not None]
    refitted = refit(final, others, [found.fit.values for found in (final, *alone)], resolution) or calibrated
    return calibrated if not others and calibrated.cost < refitted.cost else refitted


def refit(
    known: EvaluatedFit, candidates: Sequence[Candidate], starts: Sequence[Mapping[str, float]],
    resolution: TimeResolution,
) -> EvaluatedFit | None:  # fmt: skip
    """Fit a model that has just these candidates; None if it cannot be fitted.

    Args:
        known: a fit to the same measurements, whose solver error and corrections of time are used.
        candidates: the candidates.
        starts: start values (SI) by name of an unknown, for each start; an unknown without a value starts at the
            centre of its prior.
        resolution: coarse and fine time steps per sample.
    """
    of = known.fit.problem
    campaign: Campaign = of.campaign
    empty = build_problem(
        campaign, campaign.machine, Instruments(), (), solver_error=of.solver_error, time_errors=of.time_errors
    )
    problem = with_candidates(empty, candidates)
    try:
        begin = np.array([start_coordinates(problem, dict(values)) for values in starts])
        return with_tightened_bench(fit_coarse(problem, begin, resolution.coarse, REFIT_STEPS), resolution.coarse)
    except FitError:
        return None


def _without(rounds: Sequence[Round], removed: Candidate, final: EvaluatedFit) -> list[Round]:
    """The rounds without one candidate; the first keeps its baseline, the last one has the new final model."""
    kept = [dataclasses.replace(r, laws=()) for r in rounds[:-1] if r.accepted.candidate is not removed]
    last = dataclasses.replace(rounds[-1], baseline=final)
    if kept:
        laws = [law for r in rounds for law in r.laws if law is not removed and law.of != removed.id]
        kept[0] = dataclasses.replace(kept[0], baseline=rounds[0].baseline)
        kept[-1] = dataclasses.replace(kept[-1], laws=tuple(laws))
        return [*kept, last]
    baseline = min(final, rounds[0].baseline, key=lambda evaluated: evaluated.excess)
    return [dataclasses.replace(rounds[0], accepted=None, laws=(), baseline=baseline)]
