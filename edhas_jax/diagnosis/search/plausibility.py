"""Plausibility of a candidate: whether the data demand an implausible value of one of its parameters."""

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.calibration.fit_problem import gauss_newton_model
from edhas_jax.diagnosis.search.answer import temperature
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, find_minima
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.unknown_parameters import UnknownParameter

PLAUSIBLE_COORDINATE = 2.0  # prior standard deviations: the end of the plausible range
RANGE_TOLERANCE = 0.2  # in the same unit: the ends of plausible ranges are round figures, and an estimate has an error
# rise of ½χ² with a plausible value from which the data demand the implausible one: absolute [nats], which is three
# standard deviations of one parameter, and as a share of the misfit that the model leaves anyway
MIN_RISE, MIN_RISE_SHARE = 5.0, 0.1
PLAUSIBLE_STEPS = 6  # maximum number of Levenberg-Marquardt steps of the fit with plausible values only
# nats off the gain of a candidate that depends on a parameter beyond its plausible range, and a share of what the model
# leaves with it in addition: smaller differences of evidence say nothing there, but an implausible value does
PRIOR_BOUND_PENALTY, PRIOR_BOUND_SHARE = 30.0, 0.3


def beyond_plausible_range(candidate: Candidate, fit: Fit) -> list[str]:
    """Names of a candidate's parameters whose estimate is clearly beyond the end of its plausible range."""
    limit = PLAUSIBLE_COORDINATE + RANGE_TOLERANCE
    return [name for name, x in candidate.own_coordinates(fit).items() if abs(x) > limit]


class Implausibility(NamedTuple):
    """The parameters of a candidate whose implausible values the data demand, and ½χ² that these save.

    Args:
        parameters: their names; none where the data do not determine them.
        rise: rise of ½χ² [nats] with plausible values of all its parameters; infinite where it is not known.
    """

    parameters: tuple[str, ...] = ()
    rise: float = 0.0


def implausibility(candidate: Candidate, fit: Fit) -> Implausibility:
    """The parameters that the data determine to be beyond the end of the plausible range.

    Such a candidate probably imitates another cause. A parameter that the data do not determine is no evidence against
    it: a friction whose bristles are so stiff that they hardly matter is a friction all the same. To find out, the
    parameter is moved to the end of its plausible range, the others along with it as their covariance predicts, and
    the runs are simulated again. The rise of ½χ² must be clear in comparison with what the model does not explain
    anyway, because χ² of a wrong model overstates how well its parameters are known. Where it is, the model is fitted
    again with plausible values only, since the covariance holds nearby: that fit must leave clearly more as well.

    Args:
        candidate: the candidate.
        fit: a fit with it.
    """
    names = beyond_plausible_range(candidate, fit)
    if not names or isinstance(candidate, FreeTerm):  # free terms have no plausible range
        return Implausibility()
    low_high = np.array([u.bounds() for u in fit.problem.unknowns]).T
    own, order = candidate.own_unknowns(fit.problem.unknowns), [u.name for u in fit.problem.unknowns]
    points = [fit.x]
    for name in names:
        k = order.index(own[name].name)
        change = np.sign(fit.x[k]) * PLAUSIBLE_COORDINATE - fit.x[k]
        moved = fit.x + fit.covariance[:, k] / fit.covariance[k, k] * change
        points.append(fit.problem.constraints().project(moved, *low_high))
    all_runs = tuple(range(len(fit.outcomes)))
    cases = [EvaluationPoint(x, all_runs) for x in points]
    costs = gauss_newton_model(fit.problem, cases, fit.resolution.coarse).cost
    samples = sum(e.samples for e in fit.problem.equations(fit.outcomes))
    limit = max(MIN_RISE, MIN_RISE_SHARE * (costs[0] - 0.5 * samples))
    # a rise that is not finite counts: the model fails with a plausible value
    demanded = [name for name, cost in zip(names, costs[1:], strict=True) if not cost - costs[0] < limit]
    rise = _least_cost_of_plausible_values(candidate, fit, costs[0] + limit) - costs[0] if demanded else 0.0
    return Implausibility(tuple(demanded), rise) if not rise < limit else Implausibility()


def implausible_parameters(candidate: Candidate, fit: Fit) -> list[str]:
    """The names of the parameters whose implausible values the data demand, see `implausibility`."""
    return list(implausibility(candidate, fit).parameters)


def _least_cost_of_plausible_values(candidate: Candidate, fit: Fit, enough: float) -> float:
    """½χ² of a fit with all parameters of a candidate in their plausible ranges, which ends where it is `enough`.

    An ensemble, which irregular signals need, is too expensive for this question: infinity there.
    """
    if fit.problem.is_irregular:
        return math.inf
    own = {u.name for u in candidate.own_unknowns(fit.problem.unknowns).values() if u.has_prior}
    unknowns = tuple(_plausible(u) if u.name in own else u for u in fit.problem.unknowns)
    problem = dataclasses.replace(fit.problem, unknowns=unknowns)
    start = problem.constraints().project(fit.x, *np.array([u.bounds() for u in unknowns]).T)
    found = find_minima(
        problem, start, fit.resolution.coarse, PLAUSIBLE_STEPS, keep_on=lambda steps, cost: not cost < enough
    )
    least = float(np.min(found.model.cost))
    return least if math.isfinite(least) else math.inf


def _plausible(unknown: UnknownParameter) -> UnknownParameter:
    """An unknown whose values are bounded by the ends of its plausible range."""
    low, high = (unknown.value(x) for x in (-PLAUSIBLE_COORDINATE, PLAUSIBLE_COORDINATE))
    return dataclasses.replace(unknown, span=(max(low, unknown.span[0]), min(high, unknown.span[1])))


def implausibility_penalty(excess: float) -> float:
    """What an implausible parameter costs in log-evidence [nats], where the model leaves that excess of ½χ²."""
    return PRIOR_BOUND_PENALTY + PRIOR_BOUND_SHARE * max(excess, 0.0)


class ImplausibilityCost(NamedTuple):
    """What implausible values cost; nothing where the data do not demand them.

    Args:
        gain: nats off the log-evidence gain; more than 0 where they demand them.
        weight: nats off the logarithm of the weight of the name.
    """

    gain: float = 0.0
    weight: float = 0.0


def implausibility_cost(candidate: Candidate, evaluated: EvaluatedFit, gain: float) -> ImplausibilityCost:
    """What implausible values of a candidate's parameters cost.

    Neither is more than what a fit with plausible values only would lose, because that is a model of the candidate too.

    Args:
        candidate: the candidate.
        evaluated: a fit with it.
        gain: its log-evidence gain [nats].
    """
    found = implausibility(candidate, evaluated.fit)
    if not found.parameters:
        return ImplausibilityCost()
    lost = found.rise / temperature(gain, max(evaluated.excess, 0.0))
    penalty = implausibility_penalty(evaluated.excess)
    return ImplausibilityCost(min(penalty, found.rise), min(prior_cost(candidate, evaluated.fit), lost))


def prior_cost(candidate: Candidate, fit: Fit) -> float:
    """Fall of the log prior density [nats] beyond the plausible ranges of a candidate: Σ ½(x² − 2²) over |x| > 2."""
    values = candidate.own_coordinates(fit).values()
    return float(sum(0.5 * max(x**2 - PLAUSIBLE_COORDINATE**2, 0.0) for x in values))
