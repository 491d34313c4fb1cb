"""Least squares with derivatives updated by Broyden's method instead of computed at every step."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.inference.fit.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt, stacked_models
from edhas_jax.inference.fit.secant_model import SecantModel
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}
FREE = np.full(2, -np.inf), np.full(2, np.inf)


@pytest.fixture(scope="module")
def problem():
    campaign = measured(empty_campaign(), edhas.change(bench(), **TRUTH))
    return calibration_problem(campaign)


def test_a_step_gives_the_cost_of_a_full_evaluation(problem):
    """Without deviations of the bench, whose columns are kept, the cost after a step is exact."""
    bare = dataclasses.replace(problem, bench=type(problem.bench)())
    x = start_coordinates(bare, {})
    point = x + 0.2
    model, fresh = SecantModel(bare, PER_SAMPLE), SecantModel(bare, PER_SAMPLE)
    model.evaluate(x[None], np.array([0]))
    updated = model.update(point[None], np.array([0]), x[None])
    exact = fresh.evaluate(point[None], np.array([0]))
    assert updated.cost[0] == pytest.approx(exact.cost[0], rel=1e-9)


def test_updated_derivatives_are_right_along_the_step(problem):
    """The secant condition: the change of the signals that they predict for the step back is the one that was seen.

    With r the residuals and S the updated sensitivities, ½|r(x)|² = ½|r + S d|², a quadratic of the new model.
    """
    bare = dataclasses.replace(problem, bench=type(problem.bench)())
    x = start_coordinates(bare, {})
    step = np.linspace(-0.2, 0.3, len(x))
    model = SecantModel(bare, PER_SAMPLE)
    before = model.evaluate(x[None], np.array([0]))
    after = model.update((x + step)[None], np.array([0]), x[None])
    back = after.cost[0] - after.gradient[0] @ step + 0.5 * step @ after.curvature[0] @ step
    assert back == pytest.approx(before.cost[0], rel=1e-9)


def test_two_updates_equal_one_evaluation_of_what_they_say(problem):
    """A second update goes on from the point of the first, and its products are those of its columns."""
    x = start_coordinates(problem, {})
    first, second = x + 0.1, x + np.linspace(0.0, 0.2, len(x))
    model = SecantModel(problem, PER_SAMPLE)
    model.evaluate(x[None], np.array([0]))
    model.update(first[None], np.array([0]), x[None])
    model.update(second[None], np.array([0]), first[None])
    state = model._starts[0]
    np.testing.assert_array_equal(state.x, first)
    for run in state.runs:
        np.testing.assert_allclose(run.gram, run.columns.T @ run.columns, rtol=1e-7, atol=1e-6 * run.gram.max())


def test_a_fit_needs_few_evaluations_with_derivatives(problem, monkeypatch):
    counted = []
    evaluate = SecantModel.evaluate
    monkeypatch.setattr(SecantModel, "evaluate", lambda self, x, rows: counted.append(1) or evaluate(self, x, rows))
    found = fit_coarse(problem, start_coordinates(problem, {}), PER_SAMPLE, 25)
    fast = len(counted)
    monkeypatch.setattr(SecantModel, "fits_in_memory", lambda self, starts: False)
    counted.clear()
    slow = fit_coarse(problem, start_coordinates(problem, {}), PER_SAMPLE, 25)
    assert found.cost == pytest.approx(slow.cost, abs=1.0) and fast < len(counted)
    np.testing.assert_allclose(found.fit.x, slow.fit.x, atol=0.1)


def rosenbrock(x) -> QuadraticModel:
    """½|r|² with r = 100 (10 (x₂ − x₁²), 1 − x₁) at points (k, 2)."""
    models = []
    for a, b in x:
        r, jacobian = np.array([1e3 * (b - a * a), 1e2 * (1.0 - a)]), np.array([[-2e3 * a, 1e3], [-1e2, 0.0]])
        models.append(QuadraticModel(np.array([0.5 * r @ r]), (jacobian.T @ r)[None], (jacobian.T @ jacobian)[None]))
    return stacked_models(models)


def test_a_search_with_frozen_derivatives_reaches_the_minimum():
    """Residuals are exact, derivatives are kept from the last full evaluation and not updated at all."""
    kept = {}

    def evaluate(x, rows):
        kept.update({int(k): point.copy() for k, point in zip(rows, x, strict=True)})
        return rosenbrock(x)

    def update(x, rows, present):
        models = []
        for k, (a, b) in zip(rows, x, strict=True):
            r, (c, _) = np.array([1e3 * (b - a * a), 1e2 * (1.0 - a)]), kept[int(k)]
            jacobian = np.array([[-2e3 * c, 1e3], [-1e2, 0.0]])
            parts = np.array([0.5 * r @ r]), (jacobian.T @ r)[None], (jacobian.T @ jacobian)[None]
            models.append(QuadraticModel(*parts))
        return stacked_models(models)

    starts = np.array([[-1.2, 1.0], [2.0, -2.0]])
    found = levenberg_marquardt(evaluate, starts, *FREE, tolerance=1e-12, max_steps=300, update=update)
    assert found.converged.all()
    np.testing.assert_allclose(found.x, 1.0, atol=1e-4)
    np.testing.assert_allclose(found.model.cost, rosenbrock(found.x).cost, atol=1e-9)


def test_a_search_never_ends_above_a_point_that_it_has_evaluated():
    """An update that promises ever lower costs leads away; the search goes back and on without it."""

    def update(x, rows, present):
        model = rosenbrock(x)
        return QuadraticModel(np.full(len(x), -1.0), model.gradient, model.curvature)

    found = levenberg_marquardt(
        lambda x, rows: rosenbrock(x), np.array([[-1.2, 1.0]]), *FREE, tolerance=1e-12, max_steps=200, update=update
    )
    np.testing.assert_allclose(found.x[0], 1.0, atol=1e-4)
