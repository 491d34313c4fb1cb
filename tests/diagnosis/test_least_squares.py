"""The minimiser on functions whose minima are known."""

import numpy as np
import pytest

from edhas_jax.diagnosis.calibration.least_squares import Quadratic, inverse, minimise

WIDE = np.full(2, -np.inf), np.full(2, np.inf)


def rosenbrock(x, which):
    """½|r|² with r = 100 (10 (x₂ − x₁²), 1 − x₁), its minimum 0 at (1, 1)."""
    r = 100.0 * np.stack([10.0 * (x[:, 1] - x[:, 0] ** 2), 1.0 - x[:, 0]], axis=1)
    zero, one = np.zeros(len(x)), np.ones(len(x))
    jacobian = 100.0 * np.stack([np.stack([-20.0 * x[:, 0], 10.0 * one], 1), np.stack([-one, zero], 1)], 1)
    return Quadratic(
        0.5 * np.sum(r**2, 1), np.einsum("kmn,km->kn", jacobian, r), np.einsum("kmi,kmj->kij", jacobian, jacobian)
    )


def test_every_start_finds_the_minimum():
    starts = np.array([[-1.2, 1.0], [2.0, -2.0], [0.0, 5.0], [-3.0, -3.0]])
    found = minimise(rosenbrock, starts, *WIDE, tolerance=1e-12, most_steps=200)
    assert found.converged.all()
    np.testing.assert_allclose(found.x, 1.0, atol=1e-5)


def test_bounds_hold_and_the_best_inside_is_found():
    low, high = np.array([-2.0, -2.0]), np.array([0.5, 2.0])
    found = minimise(rosenbrock, np.array([[0.0, 0.0]]), low, high, tolerance=1e-12, most_steps=100)
    assert found.converged[0]
    np.testing.assert_allclose(found.x[0], [0.5, 0.25], atol=1e-5)


def test_what_is_not_free_stays():
    free = np.array([[False, True], [True, False]])
    found = minimise(rosenbrock, np.array([[0.3, 2.0], [0.3, 2.0]]), *WIDE, free=free, tolerance=1e-12)
    assert found.x[0, 0] == 0.3 and found.x[0, 1] == pytest.approx(0.09, abs=1e-6)
    assert found.x[1, 1] == 2.0 and found.x[1, 0] == pytest.approx(np.sqrt(2.0), abs=1e-2)


@pytest.mark.parametrize(("part", "value"), [
    ("cost", np.nan), ("gradient", np.nan), ("curvature", np.inf), ("curvature", 1e307)
])  # fmt: skip
def test_where_the_function_fails_no_step_goes(part, value):
    def fails_left(x, which):
        q = rosenbrock(x, which)
        getattr(q, part)[x[:, 0] < -0.5] = value
        return q

    found = minimise(fails_left, np.array([[-0.4, 1.0], [-2.0, 0.0]]), *WIDE, tolerance=1e-12, most_steps=100)
    np.testing.assert_allclose(found.x[0], 1.0, atol=1e-5)
    assert not found.converged[1] and found.at.cost[1] == np.inf


def test_starts_that_meet_are_followed_once():
    seen = []

    def watched(x, which):
        seen.append(len(x))
        return rosenbrock(x, which)

    starts = np.array([[0.9, 0.8], [0.9, 0.8000001]])
    found = minimise(watched, starts, *WIDE, tolerance=1e-12, merge=1e-6)
    assert found.converged.sum() == 1 and seen[-1] == 1


def test_a_rough_floor_ends_the_search():
    rng = np.random.default_rng(0)
    calls = []

    def rough(x, which):
        calls.append(1)
        q = rosenbrock(x, which)
        return Quadratic(q.cost + 0.3 * rng.random(len(x)), q.gradient + 50.0, q.curvature)

    found = minimise(rough, np.array([[1.0, 1.0]]), *WIDE, tolerance=1e-9, most_steps=100)
    assert found.converged[0] and len(calls) < 60


def test_the_inverse_of_a_curvature_is_positive_definite():
    """Where rounding leaves nothing of the smallest eigenvalue, too; elsewhere it is the inverse."""
    rng = np.random.default_rng(0)
    slopes = rng.standard_normal((30, 5)) * 10.0 ** np.arange(-2, 3)
    sound = slopes.T @ slopes + np.eye(5)
    np.testing.assert_allclose(inverse(sound) @ sound, np.eye(5), atol=1e-9)
    twin = slopes[:, [4, 4]] * (1.0, 1.0 + 1e-15) * 1e6
    lost = np.concatenate([slopes, twin], axis=1)
    found = inverse(lost.T @ lost + np.eye(7))
    assert np.linalg.eigvalsh(found / np.sqrt(np.outer(np.diag(found), np.diag(found)))).min() > -1e-12
    assert (np.diag(found) > 0.0).all()
