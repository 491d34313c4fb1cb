"""Derivatives along several directions against those of JAX along each."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler.multi_jvp import multi_jvp
from edhas_jax.machine.rigs import RIGS
from edhas_jax.simulation.integrator import step
from tests.support.reference import nominal, random_state

H = 20e-6


def along_each(f, primals, directions):
    """The value and the derivatives, each by a `jvp` of its own."""
    return f(*primals), [jax.jvp(f, primals, direction)[1] for direction in directions]


def agree(got, right, rtol=1e-9):
    for one, other in zip(jax.tree.leaves(got), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(one, other, rtol=rtol, atol=1e-300)


def curved(x, y):
    """All kinds of operations; the first output depends on one input, the last on none."""
    a, b = x["a"], x["b"]
    z = jnp.where(a > b, jnp.tanh(a) * y, jnp.sqrt(jnp.abs(b)) / y)
    w = jnp.maximum(z, 0.3) + jnp.minimum(a * a * b, y) ** 3
    return {"one": jnp.exp(-(a**2)), "both": (w, jnp.clip(w * z, -0.5, 0.5)), "none": jnp.asarray(2.0)}


@pytest.mark.parametrize("directions", [1, 2, 8])
def test_any_program(directions):
    rng = np.random.default_rng(directions)
    together = jax.jit(lambda *p: multi_jvp(curved, *p))
    for _ in range(20):
        primals, *along = (({"a": v[0], "b": v[1]}, v[2]) for v in rng.normal(size=(1 + directions, 3)))
        agree(together(primals, along), along_each(curved, primals, along))


def test_what_is_not_chosen_does_not_enter():
    """The other side of a selection may divide by zero."""

    def f(x):
        return jnp.where(x > 0.0, jnp.where(x > 0.0, 1.0 / x, x) * 3.0, x**2)

    _, moved = jax.jit(lambda x: multi_jvp(f, (x,), [(1.0,), (2.0,)]))(jnp.asarray(0.0))
    assert moved == [0.0, 0.0]


def test_a_direction_may_be_nothing():
    """What no direction moves is a constant: nothing is computed for it."""
    def still(x, y):
        return multi_jvp(curved, (x, y), [({"a": 0.0, "b": 0.0}, 0.0)])[1]

    program = jax.make_jaxpr(still)({"a": 0.2, "b": 0.4}, 0.5).jaxpr
    assert [v.val for v in program.outvars] == [0.0] * 4
    _, (moved,) = multi_jvp(curved, ({"a": 0.2, "b": 0.4}, 0.5), [({"a": 1.0, "b": 0.0}, 0.0)])
    agree(moved, jax.jvp(curved, ({"a": 0.2, "b": 0.4}, 0.5), ({"a": 1.0, "b": 0.0}, 0.0))[1])


@pytest.mark.parametrize("rig", ["actuator_bench", "pump_bench"])
def test_the_step_of_a_rig(rig):
    """The step linearises itself, so that these are second derivatives of the equations."""
    machine = nominal(RIGS[rig])
    names = sorted(machine.initial_state())
    rng = np.random.default_rng(3)

    def f(y):
        return step(machine, y, 0.123, H)[0]

    together = jax.jit(lambda y, along: multi_jvp(f, (y,), [(one,) for one in along]))
    each = jax.jit(lambda y, along: along_each(f, (y,), [(one,) for one in along]))
    for _ in range(6):
        y = random_state(machine, rng)
        along = [{n: abs(float(y[n])) * rng.normal() + 1e-9 for n in names} for _ in range(3)]
        (values, got), (right_values, right) = together(y, along), each(y, along)
        agree(values, right_values)
        for one, other in zip(got, right, strict=True):
            for n in names:
                scale = max(abs(float(o[n])) for o in right)
                assert abs(float(one[n]) - float(other[n])) <= 1e-8 * scale
