"""The linearised computational graph and the sparse elimination against dense Jacobians and dense solvers."""

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
from tests.support.xla import jit

STEP_SIZE = 20e-6  # s


def value_and_jacobian(f, y):
    """f(y) and {output: {input: derivative}} without structural zeros."""
    graph = linearize(f, y)
    return graph.values, jacobian(graph)


@functools.cache
def jacobians(rig: str):
    """(machine, sparse, dense): a rig with all its effects, the compiled sparse and dense Jacobians of its rates."""
    machine = nominal(RIGS[rig])

    def rates(y, known):
        return machine.evaluate(y, 0.123, STEP_SIZE, known)[1]

    sparse = jit(lambda y: value_and_jacobian(lambda z: rates(z, y), y))
    dense = jit(lambda y: jax.jacfwd(lambda z: rates(z, y))(y))
    return machine, sparse, dense


@functools.cache
def compiled_solver(rig: str):
    """The compiled solution k of (shift · I − J) k = right_side, as a function of state, right side and shift."""
    machine = nominal(RIGS[rig])

    @jit
    def solution(y, right_side, shift):
        return solve(linearize(lambda z: machine.evaluate(z, 0.123, STEP_SIZE, y)[1], y), right_side, shift)

    return solution


def random_states(machine, count=12):
    rng = np.random.default_rng(7)
    return [random_state(machine, rng) for _ in range(count)]


@pytest.mark.parametrize("rig", RIGS)
def test_jacobian_equals_jacfwd_and_structural_zeros_are_zero(rig):
    machine, sparse, dense = jacobians(rig)
    names = sorted(machine.initial_state())
    for y in random_states(machine):
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
    y = random_states(machine, 1)[0]
    plain = machine.evaluate(y, 0.123, STEP_SIZE, y)[1]
    for name, value in sparse(y)[0].items():
        np.testing.assert_allclose(value, plain[name], rtol=1e-12)


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("h", [5e-6, 20e-6, 100e-6])
def test_solve_equals_numpy(rig, h):
    machine, sparse, _ = jacobians(rig)
    names = sorted(machine.initial_state())
    points = random_states(machine, 6)
    state_size = np.array([max(abs(y[n]) for y in points) for n in names])
    for y in points:
        values, rows = jax.device_get(sparse(y))
        matrix = 2.0 / h * np.eye(len(names))
        for i, row in enumerate(names):
            for j, column in enumerate(names):
                matrix[i, j] -= rows[row].get(column, 0.0)
        right_side = np.array([2.0 * values[n] for n in names])
        solution = compiled_solver(rig)(y, {n: 2.0 * values[n] for n in names}, 2.0 / h)
        got = np.array([solution[n] for n in names])
        # each row relative to its terms, so that the units of the states do not matter
        residual = np.abs(matrix @ got - right_side) / (np.abs(matrix) @ np.abs(got) + np.abs(right_side))
        assert residual.max() < 1e-9
        expected = np.linalg.solve(matrix, right_side)
        # the absolute part covers increments of the size of the rounding error of their state
        tolerance = 1e-10 * np.abs(expected) + 1e-11 * state_size
        np.testing.assert_array_less(np.abs(got - expected), tolerance)


@pytest.mark.parametrize("right_side", [-1e13, -1e9, 0.0, 1e9, 1e13])
@pytest.mark.parametrize("pressure", [1e3, 2e5, 5e6])
def test_a_strain_unknown_is_solved_exactly_and_stays_positive(right_side, pressure):
    shift, coefficient = 1e5, 0.005 * 101325.0 * 1.4e9
    unknowns = {"p": StrainUnknown(jnp.asarray(pressure), coefficient)}
    k = solve(Graph({}, {("d", "p"): {}}), {"p": right_side}, shift, unknowns)["p"]
    after = float(pressure + k)
    assert after > 0.0
    change = (after - coefficient / after) - (pressure - coefficient / pressure)
    np.testing.assert_allclose(shift * change, right_side, rtol=1e-9, atol=1e-9 * shift * coefficient / pressure)


def test_solve_with_pivots_that_are_structurally_absent():
    graph = Graph({}, {("d", "a"): {"b": 2.0}, ("d", "b"): {"a": 3.0, "c": 1.0}, ("d", "c"): {"b": -4.0}})
    matrix = 10.0 * np.eye(3) - np.array([[0.0, 2.0, 0.0], [3.0, 0.0, 1.0], [0.0, -4.0, 0.0]])
    got = solve(graph, {"a": 1.0, "b": 2.0, "c": 3.0}, 10.0)
    np.testing.assert_allclose([got[n] for n in "abc"], np.linalg.solve(matrix, [1.0, 2.0, 3.0]), rtol=1e-13)


def test_a_branch_not_taken_contributes_nothing():
    """A branch that is infinite where it is not taken affects neither the value nor the derivative."""

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


def general(y):
    """Operations that user code may contain: branches, arrays, tables, loops, a custom derivative rule."""
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


sparse_general = jax.jit(lambda y: value_and_jacobian(general, y))
dense_general = jax.jit(lambda y: (general(y), jax.jacfwd(general)(y)))


@pytest.mark.parametrize("seed", range(6))
def test_general_functions(seed):
    y = dict(zip("abc", np.random.default_rng(seed).uniform(-1.0, 1.0, 3), strict=True))
    values, rows = sparse_general(y)
    expected, full = dense_general(y)
    for output, value in expected.items():
        np.testing.assert_allclose(values[output], value, rtol=1e-13)
        for name in "abc":
            got = rows[output].get(name, 0.0)
            np.testing.assert_allclose(got, full[output][name], rtol=1e-10, atol=1e-13, err_msg=f"{output}/{name}")
            assert jnp.shape(got) == ()
    assert set(rows["alone"]) == {"c"} and not rows["constant"]


def test_a_batch_equals_a_loop():
    rng = np.random.default_rng(3)
    batch = {n: rng.uniform(0.1, 1.0, 5) for n in "abc"}
    _, batched = jax.jit(jax.vmap(lambda y: value_and_jacobian(general, y)))(batch)
    for k in range(5):
        _, single = sparse_general({n: v[k] for n, v in batch.items()})
        for output, row in single.items():
            for name, slope in row.items():
                np.testing.assert_allclose(batched[output][name][k], slope, rtol=1e-12, atol=1e-14)


def test_second_derivatives_equal_the_hessian():
    y = {"a": 0.7, "b": 0.4, "c": 0.9}

    def function(z):
        return general(z)["vector"] + general(z)["power"]

    def gradient(z):
        _, rows = value_and_jacobian(lambda x: {"out": function(x)}, z)
        return rows["out"]

    got, expected = jax.jit(jax.jacrev(gradient))(y), jax.jit(jax.hessian(function))(y)
    for i in "abc":
        for j in "abc":
            np.testing.assert_allclose(got[i][j], expected[i][j], rtol=1e-10, atol=1e-12)


def _counted_loop(y):
    return {"out": jax.lax.fori_loop(0, 3, lambda i, x: x * y["b"] + y["a"], y["b"])}


def _mixed_branch(y):
    value, _ = jax.lax.cond(y["a"] > 0.0, lambda u: (u * u, 1), lambda u: (-u, 0), y["a"])
    return {"out": value}


def _largest(y):
    values, _ = jax.lax.top_k(jnp.stack([y["a"], y["b"]]), 1)
    return {"out": values[0]}


@pytest.mark.parametrize("f", [_counted_loop, _mixed_branch, _largest])
def test_an_operation_that_also_returns_integers_keeps_its_derivative(f):
    y = {"a": 0.7, "b": 0.4}
    _, rows = value_and_jacobian(f, y)
    for name, slope in jax.jacfwd(f)(y)["out"].items():
        np.testing.assert_allclose(rows["out"].get(name, 0.0), slope, rtol=1e-12)


@pytest.mark.parametrize(
    ("rig", "parameter"),
    [(ActuatorBench, "bristle_stiffness"), (PumpBench, "air_fraction"), (PumpBench, "valve_seat_diameter")],
)
def test_gradient_through_a_step_equals_finite_differences(rig, parameter):
    """The step contains J, so that its derivative by a parameter contains second derivatives of the equations."""
    machine = nominal(rig)
    y = random_states(machine, 3)[2]
    base = value_of(machine, parameter)
    output = "piston_velocity" if rig is ActuatorBench else "chamber_pressure_a"

    def end(value):
        return step(changed(machine, parameter, value), y, 0.1, STEP_SIZE)[0][output]

    after, got = jit(end), jit(jax.grad(end))(base)
    d = 1e-4 * base
    expected = (8.0 * (after(base + d) - after(base - d)) - (after(base + 2 * d) - after(base - 2 * d))) / (12.0 * d)
    np.testing.assert_allclose(got, expected, rtol=1e-5)
    assert got != 0.0
