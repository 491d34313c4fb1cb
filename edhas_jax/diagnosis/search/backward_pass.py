"""The backward pass: each accepted candidate is taken out again, everything refitted, and its loss compared.

A candidate that was accepted first may stand in for others that came later, and a later one may only fit what the law
of an earlier one does not. A member stays if the model without it, refitted from the values of the model with it,
leaves much more than the model with it.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.diagnosis.search.decision_rules import strength
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, start_coordinates
from edhas_jax.diagnosis.search.law_deviation import deviation_cost, law_deviation_columns
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.result import MemberTest, Round, accepted_trials
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution

REFIT_STEPS = 6  # maximum number of Levenberg-Marquardt steps of a refit without a member
MIN_LAW_STRENGTH = 1.0  # fall by a deviation of a law over what is left, from which the law differs
MIN_STRENGTH = 0.7  # of a member: gain over what is left; below it the member is removed


def take_back(
    rounds: Sequence[Round], resolution: TimeResolution, report: Callable[[str], None]
) -> tuple[list[Round], list[MemberTest]]:
    """Take each accepted candidate out, and remove those without which the model leaves little more.

    Args:
        rounds: the rounds of the search, the last of which accepted nothing.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.

    Returns:
        The rounds of the members that stay, the last of which accepts nothing, and the test of each member.
    """
    rounds, final = list(rounds), rounds[-1].baseline
    while True:
        members = [trial.candidate for trial in accepted_trials(rounds)]
        tests, without = [], []
        own = law_deviation_columns(final.fit, members) if members else None
        left = final.excess_with(own)
        for candidate in members:
            report(f"the model without {candidate.name}")
            others = [c for c in members if c is not candidate]
            refitted = _refit(final, others, rounds[0].baseline, resolution)
            deviations = law_deviation_columns(refitted.fit, others) if others else None
            before, after = refitted.excess_with(deviations), final.excess_with(deviations)
            penalty = (final.cost - refitted.cost) + (final.log_evidence - refitted.log_evidence)
            gain = before - after + penalty
            gain = max(gain, before - left + penalty - deviation_cost(own) + deviation_cost(deviations))
            tests.append(
                MemberTest(
                    candidate, gain, float(np.sum(final.left_out - refitted.left_out)),
                    strength(gain, left, final.samples),
                )
            )  # fmt: skip
            without.append(refitted)
        weakest = min(range(len(tests)), key=lambda k: tests[k].strength, default=None)
        if weakest is None or tests[weakest].strength >= MIN_STRENGTH:
            return rounds, [_with_law(test, final) for test in tests]
        report(f"{members[weakest].name} is not needed")
        final = without[weakest]
        rounds = _without_member(rounds, weakest, final)


def _with_law(test: MemberTest, final: EvaluatedFit) -> MemberTest:
    """The test of a member that stays, with the plausibility of its parameters and of the library's law."""
    implausible = tuple(implausible_parameters(test.candidate, final.fit))
    columns = law_deviation_columns(final.fit, [test.candidate])
    after = final.excess_with(columns)
    gain = final.excess - after
    differs = strength(gain - deviation_cost(columns), after, final.samples) > MIN_LAW_STRENGTH
    return test._replace(implausible=implausible, law_gain=gain, law_differs=differs)


def _refit(
    final: EvaluatedFit, others: Sequence[Candidate], calibrated: EvaluatedFit, resolution: TimeResolution
) -> EvaluatedFit:
    """The model with some members, refitted from the final values; without any, the better of it and the calibrated."""
    known = final.fit.problem
    campaign: Campaign = known.campaign
    problem = build_problem(campaign, campaign.machine, Instruments(), ())
    for k, candidate in enumerate(others):
        problem = build_problem(campaign, problem.machine, problem.instruments, others[:k], candidate)
    problem = dataclasses.replace(problem, solver_error=known.solver_error, time_shifts=known.time_shifts)
    try:
        refitted = fit_coarse(problem, start_coordinates(problem, final.fit.values), resolution.coarse, REFIT_STEPS)
    except FitError:
        refitted = calibrated
    return calibrated if not others and calibrated.cost < refitted.cost else refitted


def _without_member(rounds: Sequence[Round], index: int, final: EvaluatedFit) -> list[Round]:
    """The rounds without an accepted candidate; the first keeps its baseline, the last one has the new final model."""
    kept = [r for k, r in enumerate(rounds[:-1]) if k != index]
    last = dataclasses.replace(rounds[-1], baseline=final)
    if kept:
        kept[0] = dataclasses.replace(kept[0], baseline=rounds[0].baseline)
        return [*kept, last]
    baseline = min(final, rounds[0].baseline, key=lambda evaluated: evaluated.excess)
    return [dataclasses.replace(rounds[0], accepted=None, baseline=baseline)]
