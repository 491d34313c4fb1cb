"""Jacobian-vector products along several tangents at once against `jax.jvp` along each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler.multi_jvp import multi_jvp
from edhas_jax.machine.rigs import RIGS
from edhas_jax.simulation.integrator import step
from tests.support.reference import nominal, random_state
from tests.support.xla import jit

STEP_SIZE = 20e-6  # s


def separate_jvps(f, primals, tangents):
    """The value, and the derivative along each of the tangents by a `jax.jvp` of its own."""
    return f(*primals), [jax.jvp(f, primals, tangent)[1] for tangent in tangents]


def assert_trees_close(got, expected, rtol=1e-9):
    for leaf, other in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(leaf, other, rtol=rtol, atol=1e-300)


def nonlinear(x, y):
    """All kinds of operations; the first output depends on one input only, the last one on none."""
    a, b = x["a"], x["b"]
    z = jnp.where(a > b, jnp.tanh(a) * y, jnp.sqrt(jnp.abs(b)) / y)
    w = jnp.maximum(z, 0.3) + jnp.minimum(a * a * b, y) ** 3
    return {"one": jnp.exp(-(a**2)), "both": (w, jnp.clip(w * z, -0.5, 0.5)), "none": jnp.asarray(2.0)}


@pytest.mark.parametrize("tangent_count", [1, 2, 8])
def test_a_general_function(tangent_count):
    rng = np.random.default_rng(tangent_count)
    compiled = jit(lambda *p: multi_jvp(nonlinear, *p))
    for _ in range(20):
        primals, *tangents = (({"a": v[0], "b": v[1]}, v[2]) for v in rng.normal(size=(1 + tangent_count, 3)))
        assert_trees_close(compiled(primals, tangents), separate_jvps(nonlinear, primals, tangents))


def test_a_branch_not_taken_contributes_nothing():
    """The operand of a selection that is not selected may divide by zero."""

    def f(x):
        return jnp.where(x > 0.0, jnp.where(x > 0.0, 1.0 / x, x) * 3.0, x**2)

    _, derivatives = jit(lambda x: multi_jvp(f, (x,), [(1.0,), (2.0,)]))(jnp.asarray(0.0))
    assert derivatives == [0.0, 0.0]


def test_nothing_is_computed_for_tangents_known_to_be_zero():
    def jvp_along_zero(x, y):
        return multi_jvp(nonlinear, (x, y), [({"a": 0.0, "b": 0.0}, 0.0)])[1]

    jaxpr = jax.make_jaxpr(jvp_along_zero)({"a": 0.2, "b": 0.4}, 0.5).jaxpr
    assert [v.val for v in jaxpr.outvars] == [0.0] * 4
    primals, tangent = ({"a": 0.2, "b": 0.4}, 0.5), ({"a": 1.0, "b": 0.0}, 0.0)
    _, (derivative,) = multi_jvp(nonlinear, primals, [tangent])
    assert_trees_close(derivative, jax.jvp(nonlinear, primals, tangent)[1])


@pytest.mark.parametrize("rig", ["actuator_bench", "pump_bench"])
def test_the_step_of_a_rig(rig):
    """The step contains its own Jacobian, so that these are second derivatives of the equations."""
    machine = nominal(RIGS[rig])
    names = sorted(machine.initial_state())
    rng = np.random.default_rng(3)

    def f(y):
        return step(machine, y, 0.123, STEP_SIZE)[0]

    compiled = jit(lambda y, tangents: multi_jvp(f, (y,), [(t,) for t in tangents]))
    reference = jit(lambda y, tangents: separate_jvps(f, (y,), [(t,) for t in tangents]))
    for _ in range(6):
        y = random_state(machine, rng)
        tangents = [{n: abs(float(y[n])) * rng.normal() + 1e-9 for n in names} for _ in range(3)]
        (values, got), (expected_values, expected) = compiled(y, tangents), reference(y, tangents)
        assert_trees_close(values, expected_values)
        for derivative, other in zip(got, expected, strict=True):
            for n in names:
                scale = max(abs(float(o[n])) for o in expected)
                assert abs(float(derivative[n]) - float(other[n])) <= 1e-8 * scale
