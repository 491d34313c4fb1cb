"""Levenberg-Marquardt on functions with known minima."""

import re

import numpy as np
import pytest

from edhas_jax.inference.fit import least_squares
from edhas_jax.inference.fit.least_squares import QuadraticModel, levenberg_marquardt
from edhas_jax.inference.likelihood.symmetric_matrices import log_determinant, regularised_inverse, square_root
from tests.support import ROOT

UNBOUNDED = np.full(2, -np.inf), np.full(2, np.inf)


def rosenbrock(x, starts):
    """½|r|² with r = 100 (10 (x₂ − x₁²), 1 − x₁), its minimum 0 at (1, 1)."""
    r = 100.0 * np.stack([10.0 * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)
    zero, one = np.zeros(len(x)), np.ones(len(x))
    jacobian = 100.0 * np.stack([np.stack([-20.0 * x[:, 0], 10.0 * one], 1), np.stack([-one, zero], 1)], 1)
    return QuadraticModel(
        0.5 * np.sum(r**2, 1), np.einsum("kmn,km->kn", jacobian, r), np.einsum("kmi,kmj->kij", jacobian, jacobian)
    )


def test_every_start_reaches_the_minimum():
    starts = np.array([[-1.2, 1.0], [2.0, -2.0], [0.0, 5.0], [-3.0, -3.0]])
    found = levenberg_marquardt(rosenbrock, starts, *UNBOUNDED, tolerance=1e-12, max_steps=200)
    assert found.converged.all()
    np.testing.assert_allclose(found.x, 1.0, atol=1e-5)


def test_the_constrained_minimum_lies_on_the_bound():
    low, high = np.array([-2.0, -2.0]), np.array([0.5, 2.0])
    found = levenberg_marquardt(rosenbrock, np.array([[0.0, 0.0]]), low, high, tolerance=1e-12, max_steps=100)
    assert found.converged[0]
    np.testing.assert_allclose(found.x[0], [0.5, 0.25], atol=1e-5)


def test_fixed_coordinates_do_not_change():
    free = np.array([[False, True], [True, False]])
    found = levenberg_marquardt(rosenbrock, np.array([[0.3, 2.0], [0.3, 2.0]]), *UNBOUNDED, free=free, tolerance=1e-12)
    assert found.x[0, 0] == 0.3 and found.x[0, 1] == pytest.approx(0.09, abs=1e-6)
    assert found.x[1, 1] == 2.0 and found.x[1, 0] == pytest.approx(np.sqrt(2.0), abs=1e-2)


@pytest.mark.parametrize(("part", "value"), [
    ("cost", np.nan), ("gradient", np.nan), ("curvature", np.inf), ("curvature", 1e307)
])  # fmt: skip
def test_steps_to_non_finite_points_are_rejected(part, value):
    def partly_failing(x, starts):
        model = rosenbrock(x, starts)
        getattr(model, part)[x[:, 0] < -0.5] = value
        return model

    starts = np.array([[-0.4, 1.0], [-2.0, 0.0]])
    found = levenberg_marquardt(partly_failing, starts, *UNBOUNDED, tolerance=1e-12, max_steps=100)
    np.testing.assert_allclose(found.x[0], 1.0, atol=1e-5)
    assert not found.converged[1] and found.model.cost[1] == np.inf


def test_starts_that_meet_are_merged():
    batch_sizes = []

    def recorded(x, starts):
        batch_sizes.append(len(x))
        return rosenbrock(x, starts)

    starts = np.array([[0.9, 0.8], [0.9, 0.8000001]])
    found = levenberg_marquardt(recorded, starts, *UNBOUNDED, tolerance=1e-12, merge=1e-6)
    assert found.converged.sum() == 1 and batch_sizes[-1] == 1


def test_a_noisy_cost_ends_the_search():
    rng = np.random.default_rng(0)
    calls = []

    def noisy(x, starts):
        calls.append(1)
        model = rosenbrock(x, starts)
        return QuadraticModel(model.cost + 0.3 * rng.random(len(x)), model.gradient + 50.0, model.curvature)

    found = levenberg_marquardt(noisy, np.array([[1.0, 1.0]]), *UNBOUNDED, tolerance=1e-9, max_steps=100)
    assert found.converged[0] and len(calls) < 60


@pytest.mark.parametrize("zeroed", [0, 2])
def test_a_direction_without_information_has_a_large_finite_variance(zeroed):
    """A curvature with an empty row, and one of rank two; neither the inverse nor the determinant fails."""
    slopes = np.random.default_rng(3).standard_normal((2, 4))
    curvature = slopes.T @ slopes
    curvature[:, :zeroed] = curvature[:zeroed] = 0.0
    covariance = regularised_inverse(curvature)
    assert np.isfinite(covariance).all() and np.diag(covariance).max() > 1e10
    assert np.isfinite(log_determinant(curvature)) and np.isfinite(log_determinant(covariance))
    root = square_root(covariance)
    np.testing.assert_allclose(root @ root.T, covariance, rtol=1e-6, atol=1e-6 * np.abs(covariance).max())
    assert np.isnan(regularised_inverse(np.full((2, 2), np.nan))).all() and np.isnan(log_determinant([[np.inf]]))


def test_no_other_module_inverts_a_matrix():
    """Curvatures and covariances are inverted in `symmetric_matrices` from eigenvalues, never by these functions."""
    inverse = re.compile(r"linalg\.(inv|pinv|solve|cholesky|det|slogdet)|cho_(factor|solve)")
    modules = (ROOT / "edhas_jax").rglob("*.py")
    assert not [p.name for p in modules if inverse.search(p.read_text(encoding="utf-8"))]


def test_the_regularised_inverse_is_positive_definite():
    """Also where rounding removes the smallest eigenvalue; a well conditioned matrix is inverted exactly."""
    rng = np.random.default_rng(0)
    slopes = rng.standard_normal((30, 5)) * 10.0 ** np.arange(-2, 3)
    sound = slopes.T @ slopes + np.eye(5)
    np.testing.assert_allclose(regularised_inverse(sound) @ sound, np.eye(5), atol=1e-9)
    twin = slopes[:, [4, 4]] * (1.0, 1.0 + 1e-15) * 1e6
    lost = np.concatenate([slopes, twin], axis=1)
    found = regularised_inverse(lost.T @ lost + np.eye(7))
    assert np.linalg.eigvalsh(found / np.sqrt(np.outer(np.diag(found), np.diag(found)))).min() > -1e-12
    assert (np.diag(found) > 0.0).all()


def test_a_search_whose_steps_are_not_numbers_has_not_converged(monkeypatch):
    nan = np.full(2, np.nan), np.nan, np.nan
    monkeypatch.setattr(least_squares, "proposed_step", lambda *_: nan)
    with np.errstate(invalid="ignore"):
        found = levenberg_marquardt(rosenbrock, np.array([[-1.2, 1.0]]), *UNBOUNDED, max_steps=5)
    assert not found.converged[0] and (found.x[0] == (-1.2, 1.0)).all()
