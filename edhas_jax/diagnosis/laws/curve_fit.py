"""Estimate a law as a free curve: a refit of the model in which a table takes the place of the law.

All unknowns of the fit stay free together with the values at the nodes, so that whatever a parameter could reproduce as
well widens the error band of the curve. Where the data say nothing, the curve stays near the library's law, or near
zero, and smooth (`curve_prior`).
"""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.diagnosis.laws.curve_basis import fit_values
from edhas_jax.diagnosis.laws.curve_prior import CurvePrior, PriorChoice, choose_prior, without_others
from edhas_jax.diagnosis.laws.curve_start import CurveStart, start_beside_law, start_from_nothing, with_law_of
from edhas_jax.diagnosis.laws.law_curve import LawCurve, curve_name
from edhas_jax.diagnosis.laws.law_samples import law_samples
from edhas_jax.diagnosis.laws.linearised_model import Linearisation, PointEvaluator, bounded_minimum
from edhas_jax.inference.fit.fit import CORRECTION_REFINEMENT, Fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem
from edhas_jax.inference.likelihood.symmetric_matrices import regularised_inverse
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable
from edhas_jax.machine.interface.slots import Rule
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

MAX_LINEARISATIONS = 12  # linearisations of one search
# of the steps that are compared, over the diagonal of the curvature
CURVE_DAMPINGS = np.array([0.0, 1e-3, 1e-2, 1e-1, 1.0, 10.0])
COARSE_TOLERANCE, FINE_TOLERANCE = 5.0, 1.0  # fall of ½χ² below which a search has converged


class CurveFit(NamedTuple):
    """A model with a free curve, fitted.

    Attributes:
        curve: the curve with its standard errors.
        fit: the fit of all unknowns; the last ones are the values at the nodes, whose joint prior is that of
            `curve_prior` and is not among the priors of the unknowns.
    """

    curve: LawCurve
    fit: Fit


def estimate_law_curve(
    fit: Fit, effect: str, on_progress: Callable[[str], None] | None = None, deviation: str | None = None,
    alone: Fit | None = None,
) -> CurveFit | None:  # fmt: skip
    """Estimate the law of an effect as a free curve over the variable that explains most of it.

    A law that is a function of this variable is replaced by the curve; else (several variables, states, two slots) the
    curve is added to it.

    Args:
        fit: a fit whose machine has the effect.
        effect: id of the effect.
        on_progress: called with a sentence on the progress.
        deviation: id of a tabulated deviation of this law that the machine has; the curve takes its place too.
        alone: a fit of the effect without that deviation. Its law is the first guess of the curve, and the law that the
            curve is compared with; the law in `fit` is only a part of the sum of law and deviation.

    Returns:
        The curve and the model with it; None where the law vanishes or its slot has no variable.

    Raises:
        FitError: the model with the curve fails.
    """
    mounted = next(e for e in fit.machine.effects if e.id == effect)
    start = start_beside_law(fit, mounted)
    if start is not None and alone is not None:
        start = with_law_of(start, start_beside_law(alone, next(e for e in alone.machine.effects if e.id == effect)))
    replaced = tuple(name for name in (effect if start and start.replaces else None, deviation) if name is not None)
    return None if start is None else _estimate(fit, start, effect, replaced, on_progress)


def estimate_free_curve(
    fit: Fit, place: LawPlace, nodes: np.ndarray | None = None, on_progress: Callable[[str], None] | None = None
) -> CurveFit | None:
    """Estimate a law at a place where none is known.

    Args:
        fit: the fit.
        place: slot, variable and factors.
        nodes: nodes (n,) in SI; by default eleven over the range of the variable.
        on_progress: called with a sentence on the progress.

    Returns:
        The curve and the model with it; None where the variable is constant.

    Raises:
        FitError: the model with the curve fails.
    """
    start = start_from_nothing(fit, place, nodes)
    return None if start is None else _estimate(fit, start, None, (), on_progress)


def _estimate(
    fit: Fit, start: CurveStart, effect: str | None, replaced: Sequence[str],
    on_progress: Callable[[str], None] | None,
) -> CurveFit:  # fmt: skip
    """The curve and the fit with it in place of some effects, from its start."""
    name = _unused_name(fit.machine, curve_name(start.place, effect))
    problem, x = curve_problem(fit, start, name, replaced)
    n = len(start.nodes)
    report = on_progress or (lambda sentence: None)
    coarse, exact = fit.resolution.coarse, exact_steps(fit)
    refined = [(fit.resolution.fine, exact, FINE_TOLERANCE)]
    for slope_steps, steps, tolerance in refined if exact == coarse else [(coarse, coarse, COARSE_TOLERANCE), *refined]:
        found = _search(problem, PointEvaluator(problem, slope_steps, steps), x, start.nodes, tolerance, report)
        x = found.at.x
    whole = _with_prior(found.at, found.choice.prior, start.nodes)
    covariance = regularised_inverse(whole.curvature)
    fitted = Fit(problem, x, x, covariance, whole.cost, found.at.outcomes, fit.resolution, found.converged, np.zeros(0))
    values = start.centre + start.size * x[-n:]
    std = start.size * fitted.std[-n:]
    total = values if start.replaces else _with_law(fitted, start, effect, values)
    visible, _ = without_others(found.at.curvature, found.at.gradient, n)
    curve = LawCurve(
        name, start.place, "" if start.replaces else effect, start.nodes, values, std, start.law_values, total,
        _share_of_law(start, total, visible), found.choice.log_evidence_gain, start.x, start.law,
    )  # fmt: skip
    return CurveFit(curve, fitted)


def curve_problem(fit: Fit, start: CurveStart, name: str, replaced: Sequence[str]) -> tuple[FitProblem, np.ndarray]:
    """The fit problem of a model with a curve, and the coordinates at which it begins.

    Args:
        fit: the fit without the curve.
        start: place, nodes and first values of the curve.
        name: id of the curve as an effect.
        replaced: ids of the effects whose place the curve takes.

    Returns:
        The problem, whose last unknowns are the values at the nodes on a linear scale in units of `start.size`, without
        a prior of their own; the coordinates of the fit, followed by zeros.
    """
    known = fit.problem
    table = LawTable(name, start.place, start.nodes, start.centre)
    effects = (*(e for e in known.machine.effects if e.id not in replaced), table.effect())
    machine = structs.replace(known.machine, effects=effects)
    kept = [
        k for k, u in enumerate(known.unknowns)
        if known.instruments.find(u.name) or find_parameter(known.machine, u.parameters[0])[1] not in replaced
    ]  # fmt: skip
    unit = start.place.value_unit
    values = tuple(
        UnknownParameter(
            f"{name}.value_{k}", float(centre), start.size, unit, (-math.inf, math.inf), ParameterScale.LINEAR, False
        )
        for k, centre in enumerate(start.centre, 1)
    )
    problem = dataclasses.replace(known, machine=machine, unknowns=(*(known.unknowns[k] for k in kept), *values))
    return problem, np.concatenate([fit.x[kept], np.zeros(len(values))])


class _Found(NamedTuple):
    """The end of a search: the model linearised there, the prior of the curve, and whether the search converged."""

    at: Linearisation
    choice: PriorChoice
    converged: bool


def _search(
    problem: FitProblem, evaluator: PointEvaluator, x: np.ndarray, nodes: np.ndarray, tolerance: float,
    report: Callable[[str], None],
) -> _Found:  # fmt: skip
    """Minimise ½χ² with the most probable prior of the curve, from a point (k,).

    From every linearisation steps of several dampings are compared, which need no derivatives.

    Raises:
        FitError: the model fails at the first point.
    """
    at = evaluator.linearise(x)
    if not at.is_finite:
        raise FitError("the model with a free curve fails (it is not finite, or leaves its physical range)")
    for _ in range(MAX_LINEARISATIONS):
        choice = _choose_prior(at, nodes)
        whole = _with_prior(at, choice.prior, nodes)
        report(f"fitting the curve: ½χ² {at.cost:.0f}")
        scale = np.diag(np.diag(whole.curvature))
        points = np.array([
            bounded_minimum(problem, at.x, whole.gradient, whole.curvature + damping * scale)
            for damping in CURVE_DAMPINGS
        ])  # fmt: skip
        costs = evaluator.costs(points, at) + np.array([_prior_cost(point, choice.prior, nodes) for point in points])
        best = int(np.argmin(costs))
        if not costs[best] < whole.cost - tolerance:
            return _Found(at, choice, True)
        moved = evaluator.linearise(points[best])
        if not moved.is_finite:
            return _Found(at, choice, False)
        at = moved
    return _Found(at, _choose_prior(at, nodes), False)


def _choose_prior(at: Linearisation, nodes: np.ndarray) -> PriorChoice:
    return choose_prior(at.curvature, at.gradient, at.x[-len(nodes) :], nodes, 1.0)


def _prior_cost(x: np.ndarray, prior: CurvePrior, nodes: np.ndarray) -> float:
    deviation = x[-len(nodes) :]
    return 0.5 * float(deviation @ prior.precision(nodes) @ deviation)


def _with_prior(at: Linearisation, prior: CurvePrior, nodes: np.ndarray) -> Linearisation:
    """½χ² with the prior of the curve, whose values at the nodes are the last coordinates."""
    precision, own = prior.precision(nodes), slice(-len(nodes), None)
    gradient, curvature = np.array(at.gradient), np.array(at.curvature)
    gradient[own] += precision @ at.x[own]
    curvature[own, own] += precision
    return Linearisation(at.x, at.cost + _prior_cost(at.x, prior, nodes), gradient, curvature, at.outcomes)


def exact_steps(fit: Fit) -> int:
    """Time steps per sample at which the signals of a fit were taken, where it was refined; else those of the fit."""
    refined = fit.resolution.coarse != fit.resolution.fine
    return CORRECTION_REFINEMENT * fit.resolution.fine if refined else fit.resolution.coarse


def _with_law(fit: Fit, start: CurveStart, effect: str, values: np.ndarray) -> np.ndarray:
    """The whole law (n,) at the nodes where the library's law stays in the model, as fitted with the curve."""
    place = start.place
    samples = law_samples(fit, (place,), effect)
    x, weight = samples.values[place.variable], samples.weight(place)
    law = fit_values(start.nodes, x, samples.law - place.neutral, weight) + place.neutral
    return law * values if place.declaration.rule is Rule.SCALE else law + values


def _share_of_law(start: CurveStart, total: np.ndarray, visible: np.ndarray) -> float | None:
    """The share of the whole law that the library's law explains at its best size, 0 … 1.

    Shares are those of χ²: parts of a law that the runs do not see, or that other unknowns reproduce, do not count.

    Args:
        start: gives the library's law at the nodes.
        total: the whole law (n,).
        visible: curvature (n, n) of ½χ² by the values of the curve, all other unknowns adjusted.
    """
    if start.law_values is None:
        return None
    whole, law = total - start.place.neutral, start.law_values - start.place.neutral
    shown = (whole @ visible @ whole) * (law @ visible @ law)
    return float(np.clip((whole @ visible @ law) ** 2 / shown, 0.0, 1.0)) if shown > 0.0 else 0.0


def _unused_name(machine: Rig, name: str) -> str:
    """The name, or one with a number that no effect of the machine has."""
    taken, out, number = {effect.id for effect in machine.effects}, name, 1
    while out in taken:
        number += 1
        out = f"{name}_{number}"
    return out
