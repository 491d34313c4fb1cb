"""The sparse linearisation and the sparse elimination against dense ones."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler.derivative_graph import Graph, linearize
from edhas_jax.compiler.sparse_elimination import StrainUnknown, jacobian, solve
from edhas_jax.machine.rigs import RIGS, ActuatorBench, PumpBench
from edhas_jax.simulation.integrator import step
from tests.support.reference import changed, nominal, random_state, value_of

H = 20e-6


def value_and_jacobian(f, y):
    """f(y) and {output: {input: derivative}} without structural zeros."""
    graph = linearize(f, y)
    return graph.values, jacobian(graph)


@functools.cache
def jacobians(rig: str):
    """(machine, sparse, dense): compiled Jacobians of the rates of a rig with all its effects."""
    machine = nominal(RIGS[rig])

    def rates(y, known):
        return machine.evaluate(y, 0.123, H, known)[1]

    sparse = jax.jit(lambda y: value_and_jacobian(lambda z: rates(z, y), y))
    dense = jax.jit(lambda y: jax.jacfwd(lambda z: rates(z, y))(y))
    return machine, sparse, dense


@functools.cache
def solver(rig: str):
    """k from (shift · I − J) k = right, compiled."""
    machine = nominal(RIGS[rig])

    @jax.jit
    def solved(y, right, shift):
        return solve(linearize(lambda z: machine.evaluate(z, 0.123, H, y)[1], y), right, shift)

    return solved


def states(machine, count=12):
    rng = np.random.default_rng(7)
    return [random_state(machine, rng) for _ in range(count)]


@pytest.mark.parametrize("rig", RIGS)
def test_jacobian_equals_jacfwd_and_what_is_left_out_is_zero(rig):
    machine, sparse, dense = jacobians(rig)
    names = sorted(machine.initial_state())
    for y in states(machine):
        values, rows = jax.device_get(sparse(y))
        full = jax.device_get(dense(y))
        assert sorted(values) == sorted(rows) == names
        for i in names:
            scale = max(abs(full[i][j]) for j in names)
            for j in names:
                np.testing.assert_allclose(rows[i].get(j, 0.0), full[i][j], rtol=1e-9, atol=1e-14 * scale)
                assert j in rows[i] or full[i][j] == 0.0
    assert sum(len(row) for row in rows.values()) < 0.5 * len(names) ** 2 or rig == "actuator_bench"


@pytest.mark.parametrize("rig", RIGS)
def test_values_equal_the_rates(rig):
    machine, sparse, _ = jacobians(rig)
    y = states(machine, 1)[0]
    plain = machine.evaluate(y, 0.123, H, y)[1]
    for name, value in sparse(y)[0].items():
        np.testing.assert_allclose(value, plain[name], rtol=1e-12)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("h", [5e-6, 20e-6, 100e-6])
def test_solve_equals_numpy(rig, h):
    machine, sparse, _ = jacobians(rig)
    names = sorted(machine.initial_state())
    points = states(machine, 6)
    size = np.array([max(abs(y[n]) for y in points) for n in names])
    for y in points:
        values, rows = jax.device_get(sparse(y))
        matrix = 2.0 / h * np.eye(len(names))
        for i, row in enumerate(names):
            for j, column in enumerate(names):
                matrix[i, j] -= rows[row].get(column, 0.0)
        right = np.array([2.0 * values[n] for n in names])
        solved = solver(rig)(y, {n: 2.0 * values[n] for n in names}, 2.0 / h)
        got = np.array([solved[n] for n in names])
        # row by row, relative to the terms of the row: free of the units of the states
        residual = np.abs(matrix @ got - right) / (np.abs(matrix) @ np.abs(got) + np.abs(right))
        assert residual.max() < 1e-9
        wanted = np.linalg.solve(matrix, right)
        # a change that is rounding beside the size of its state is no difference
        room = 1e-10 * np.abs(wanted) + 1e-11 * size
        np.testing.assert_array_less(np.abs(got - wanted), room)


@pytest.mark.parametrize("right", [-1e13, -1e9, 0.0, 1e9, 1e13])
@pytest.mark.parametrize("pressure", [1e3, 2e5, 5e6])
def test_a_bent_unknown_is_solved_exactly_and_stays_positive(right, pressure):
    shift, pole = 1e5, 0.005 * 101325.0 * 1.4e9
    k = solve(Graph({}, {("d", "p"): {}}), {"p": right}, shift, {"p": StrainUnknown(jnp.asarray(pressure), pole)})["p"]
    after = float(pressure + k)
    assert after > 0.0
    moved = (after - pole / after) - (pressure - pole / pressure)
    np.testing.assert_allclose(shift * moved, right, rtol=1e-9, atol=1e-9 * shift * pole / pressure)


def test_solve_with_pivots_that_are_structurally_absent():
    graph = Graph({}, {("d", "a"): {"b": 2.0}, ("d", "b"): {"a": 3.0, "c": 1.0}, ("d", "c"): {"b": -4.0}})
    matrix = 10.0 * np.eye(3) - np.array([[0.0, 2.0, 0.0], [3.0, 0.0, 1.0], [0.0, -4.0, 0.0]])
    got = solve(graph, {"a": 1.0, "b": 2.0, "c": 3.0}, 10.0)
    np.testing.assert_allclose([got[n] for n in "abc"], np.linalg.solve(matrix, [1.0, 2.0, 3.0]), rtol=1e-13)


def test_what_was_not_chosen_does_not_enter():
    """A branch that is infinite where it is not chosen must leave no trace, in value nor in slope."""

    def f(y):
        x = y["x"]
        return {"x": jnp.where(x > 0.0, jnp.sqrt(x), 0.0) + jnp.maximum(1.0 / x, 5.0)}

    _, rows = value_and_jacobian(f, {"x": 0.0})
    assert not np.isnan(rows["x"]["x"])
    _, rows = value_and_jacobian(lambda y: {"x": jnp.where(y["x"] > 0.0, jnp.sqrt(y["x"]), y["x"])}, {"x": 0.0})
    assert rows["x"]["x"] == 1.0


@jax.custom_jvp
def _cube(x):
    return x * x * x


_cube.defjvp(lambda primals, tangents: (_cube(primals[0]), 3.0 * jnp.square(primals[0]) * tangents[0]))


def awkward(y):
    """What a user may write: branches, vectors, tables, loops, a rule of its own."""
    a, b, c = y["a"], y["b"], y["c"]
    vector = jnp.stack([a, b, jnp.sin(c)])
    branch = jax.lax.cond(a > 0.5, lambda u, v: u * v, lambda u, v: u - jnp.exp(v), a, b)
    table = jnp.interp(b, jnp.array([-1.0, 0.0, 2.0]), jnp.array([3.0, 1.0, 4.0]))
    loop, _ = jax.lax.scan(lambda x, _: (x * c + a, None), b, length=3)
    return {
        "branch": branch + jnp.where(b > 0.0, a * c, b),
        "vector": jnp.dot(vector, vector) + jnp.max(vector) + vector[1],
        "power": jnp.power(jnp.abs(a) + 1.0, b) + a**3 + jnp.power(c, -2.0),
        "clip": jnp.clip(a * b, -0.2, 0.3) + jnp.minimum(c, a) + jnp.sign(b) * c,
        "table": table * jnp.arctan2(a, c) + jax.nn.softplus(b),
        "loop": loop,
        "rule": _cube(a * b) + jax.lax.stop_gradient(c) * a,
        "inner": jax.jit(lambda u: jnp.tanh(u) * b)(a),
        "alone": c,
        "twice": a + a,
        "constant": jnp.asarray(2.5),
    }


sparse_awkward = jax.jit(lambda y: value_and_jacobian(awkward, y))
dense_awkward = jax.jit(lambda y: (awkward(y), jax.jacfwd(awkward)(y)))


@pytest.mark.parametrize("seed", range(6))
def test_awkward_functions(seed):
    y = dict(zip("abc", np.random.default_rng(seed).uniform(-1.0, 1.0, 3), strict=True))
    values, rows = sparse_awkward(y)
    wanted, full = dense_awkward(y)
    for output, value in wanted.items():
        np.testing.assert_allclose(values[output], value, rtol=1e-13)
        for name in "abc":
            got = rows[output].get(name, 0.0)
            np.testing.assert_allclose(got, full[output][name], rtol=1e-10, atol=1e-13, err_msg=f"{output}/{name}")
            assert jnp.shape(got) == ()
    assert set(rows["alone"]) == {"c"} and not rows["constant"]


def test_a_batch_equals_a_loop():
    rng = np.random.default_rng(3)
    batch = {n: rng.uniform(0.1, 1.0, 5) for n in "abc"}
    _, together = jax.jit(jax.vmap(lambda y: value_and_jacobian(awkward, y)))(batch)
    for k in range(5):
        _, alone = sparse_awkward({n: v[k] for n, v in batch.items()})
        for output, row in alone.items():
            for name, slope in row.items():
                np.testing.assert_allclose(together[output][name][k], slope, rtol=1e-12, atol=1e-14)


def test_second_derivatives_equal_the_hessian():
    y = {"a": 0.7, "b": 0.4, "c": 0.9}

    def chosen(z):
        return awkward(z)["vector"] + awkward(z)["power"]

    def slopes(z):
        _, rows = value_and_jacobian(lambda x: {"chosen": chosen(x)}, z)
        return rows["chosen"]

    got, wanted = jax.jit(jax.jacrev(slopes))(y), jax.jit(jax.hessian(chosen))(y)
    for i in "abc":
        for j in "abc":
            np.testing.assert_allclose(got[i][j], wanted[i][j], rtol=1e-10, atol=1e-12)


def _counted_loop(y):
    return {"out": jax.lax.fori_loop(0, 3, lambda i, x: x * y["b"] + y["a"], y["b"])}


def _mixed_branch(y):
    value, _ = jax.lax.cond(y["a"] > 0.0, lambda u: (u * u, 1), lambda u: (-u, 0), y["a"])
    return {"out": value}


def _largest(y):
    values, _ = jax.lax.top_k(jnp.stack([y["a"], y["b"]]), 1)
    return {"out": values[0]}


@pytest.mark.parametrize("f", [_counted_loop, _mixed_branch, _largest])
def test_an_operation_that_also_returns_integers_keeps_its_slope(f):
    y = {"a": 0.7, "b": 0.4}
    _, rows = value_and_jacobian(f, y)
    for name, slope in jax.jacfwd(f)(y)["out"].items():
        np.testing.assert_allclose(rows["out"].get(name, 0.0), slope, rtol=1e-12)


@pytest.mark.parametrize(
    ("rig", "parameter"),
    [(ActuatorBench, "bristle_stiffness"), (PumpBench, "air_fraction"), (PumpBench, "valve_seat_diameter")],
)
def test_gradient_through_a_step_equals_differences(rig, parameter):
    """The step holds J, so its derivative by a parameter holds ∂J/∂parameter: second derivatives of the equations."""
    machine = nominal(rig)
    y = states(machine, 3)[2]
    base = value_of(machine, parameter)
    output = "piston_velocity" if rig is ActuatorBench else "chamber_pressure_a"

    @jax.jit
    def after(value):
        return step(changed(machine, parameter, value), y, 0.1, H)[0][output]

    got = jax.grad(after)(base)
    d = 1e-4 * base
    wanted = (8.0 * (after(base + d) - after(base - d)) - (after(base + 2 * d) - after(base - 2 * d))) / (12.0 * d)
    np.testing.assert_allclose(got, wanted, rtol=1e-5)
    assert got != 0.0
