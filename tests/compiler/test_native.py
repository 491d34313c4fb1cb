"""Loops as machine code: whole steps against XLA, independence of the lanes, reverse mode, threads."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.compiler.native_adjoint import STRETCH, AdjointLoop
from edhas_jax.compiler.native_loop import Loop
from edhas_jax.compiler.threads import each
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.simulation.integrator import step

EPS = {"float32": 2.0**-23, "float64": 2.0**-52}


def decay(n, carry, lane, uniform):
    """Two states that depend on the number of the step, on the lane and on what is common."""
    x = carry["x"] * (1.0 - lane["rate"] * uniform["h"]) + jnp.sin(0.1 * n)
    return {"x": x, "steps": carry["steps"] + 1.0}


@pytest.mark.parametrize("dtype", EPS)
@pytest.mark.parametrize("lanes", [1, 7, 33, 200])
def test_a_loop_counts_its_steps_and_keeps_what_was_asked(dtype, lanes):
    rate = np.linspace(0.0, 3.0, lanes)
    loop = Loop(decay, dtype, {"x": 0.0, "steps": 0.0}, {"rate": 0.0}, {"h": 0.0})
    start = {"x": np.ones(lanes), "steps": np.zeros(lanes)}
    marched = loop.march(start, {"rate": rate}, {"h": 0.01}, 5, 3, 4)
    x, expected = np.ones(lanes), []
    for n in range(12):
        if n % 3 == 0:
            expected.append(x)
        x = x * (1.0 - rate * 0.01) + np.sin(0.1 * (5 + n))
    np.testing.assert_allclose(marched.kept["x"], expected, rtol=40 * EPS[dtype], atol=40 * EPS[dtype])
    np.testing.assert_allclose(marched.carry["x"], x, rtol=40 * EPS[dtype], atol=40 * EPS[dtype])
    np.testing.assert_array_equal(marched.kept["steps"], np.repeat([[0.0], [3.0], [6.0], [9.0]], lanes, axis=1))
    again = loop(start, {"rate": rate}, {"h": 0.01}, 5, 12, threads=3)
    np.testing.assert_array_equal(again["x"], marched.carry["x"])


def test_what_is_fed_changes_from_sample_to_sample():
    def body(n, carry, lane, uniform, fed):
        return {"x": carry["x"] + lane["k"] * fed["a"] + fed["b"]}

    loop = Loop(body, float, {"x": 0.0}, {"k": 0.0}, (), fed={"a": 0.0, "b": 0.0})
    a, b, k = np.array([1.0, 2.0, 4.0]), np.array([0.0, 10.0, 0.0]), np.arange(20.0)
    got = loop.march({"x": np.zeros(20)}, {"k": k}, (), 0, 5, 3, fed={"a": a, "b": b})
    np.testing.assert_allclose(got.kept["x"][1:], [5 * k, 15 * k + 50])
    np.testing.assert_allclose(got.carry["x"], 35 * k + 50)


def test_a_lane_does_not_depend_on_its_place_or_its_neighbours():
    rng = np.random.default_rng(0)
    rate = rng.random(100)
    loop = Loop(decay, "float32", {"x": 0.0, "steps": 0.0}, {"rate": 0.0}, {"h": 0.0})

    def run(some):
        return loop({"x": some, "steps": 0.0 * some}, {"rate": some}, {"h": 0.01}, 0, 50)["x"]

    whole, order = run(rate), rng.permutation(100)[:37]
    np.testing.assert_array_equal(run(rate[order]), whole[order])
    spoilt = rate.copy()
    spoilt[3] = np.nan
    np.testing.assert_array_equal(np.delete(run(spoilt), 3), np.delete(whole, 3))


@pytest.mark.parametrize("dtype", EPS)
def test_vectors_side_by_side_change_no_bit(dtype):
    machine = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), edhas.PumpBench(effects=(LugreFriction(),)))
    start = {n: np.full(70, v, dtype) for n, v in machine.initial_state().items()}
    diameter = {"piston_diameter": np.linspace(8e-3, 15e-3, 70, dtype=dtype)}

    def body(n, y, lane, uniform):
        return step(set_parameters(uniform[0], lane), y, n * uniform[1], uniform[1])[0]

    examples = {n: 0.0 for n in start}, {"piston_diameter": 0.0}, (machine, 0.0)
    loops = [Loop(body, dtype, *examples, vectors=vectors) for vectors in (1, 2, 4)]
    one, *others = [loop(start, diameter, (machine, 2e-5), 0, 800) for loop in loops]
    for other in others:
        jax.tree.map(np.testing.assert_array_equal, other, one)


def test_the_step_of_a_pump_is_that_of_xla():
    machine = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    start = {n: float(v) for n, v in machine.initial_state().items()}
    diameter, h = np.linspace(8e-3, 15e-3, 20), 20e-6

    def body(n, y, lane, uniform):
        return step(set_parameters(uniform[0], lane), y, n * uniform[1], uniform[1])[0]

    loop = Loop(body, float, start, {"piston_diameter": 0.0}, (machine, 0.0))
    got = loop({n: np.full(20, v) for n, v in start.items()}, {"piston_diameter": diameter}, (machine, h), 0, 1500)

    def one(d):
        values = {"piston_diameter": d}
        y = {n: jnp.asarray(v) for n, v in start.items()}
        return jax.lax.fori_loop(0, 1500, lambda n, y: body(n * 1.0, y, values, (machine, h)), y)

    expected = jax.jit(jax.vmap(one))(diameter)
    for name in start:
        scale = np.abs(expected[name]).max()
        np.testing.assert_allclose(got[name], expected[name], rtol=0, atol=1e-10 * scale, err_msg=name)


def test_derivatives_pass_through():
    def body(n, carry, lane, uniform):
        f = lambda x: jnp.tanh(x) + jnp.exp(-x * x) / (1.0 + jnp.sqrt(x)) + jnp.maximum(x, 1.0) ** 2.5  # noqa: E731
        return dict(zip(("y", "dy"), jax.jvp(f, (lane["x"],), (1.0,)), strict=True))

    x = np.linspace(0.2, 3.0, 40)
    loop = Loop(body, float, {"y": 0.0, "dy": 0.0}, {"x": 0.0}, ())
    got = loop({"y": 0 * x, "dy": 0 * x}, {"x": x}, (), 0, 1)
    f = lambda x: jnp.tanh(x) + jnp.exp(-x * x) / (1.0 + jnp.sqrt(x)) + jnp.maximum(x, 1.0) ** 2.5  # noqa: E731
    np.testing.assert_allclose(got["dy"], jax.vmap(jax.grad(f))(x), rtol=1e-13)


def test_back_through_a_loop():
    """The covectors of a reversed loop are those of reverse mode through the same steps, whatever the stretches."""

    def body(n, carry, lane, uniform):
        x, v = carry
        force = -lane["k"] * x - uniform * v * jnp.abs(v) + jnp.sin(0.1 * n)
        return x + 0.05 * v, v + 0.05 * jnp.where(x > 0.5, 2.0 * force, force)

    steps, count = 2 * STRETCH + 7, 3
    start = np.linspace(0.2, 0.9, count), np.linspace(-1.0, 1.0, count)
    lane, uniform = {"k": np.array([1.0, 2.0, 3.0])}, 0.3
    loop = AdjointLoop(body, float, (0.0, 0.0), {"k": 0.0}, 0.0)
    end, trail = loop.run(start, lane, uniform, steps)
    weights = [(np.ones(count), np.zeros(count)), (np.zeros(count), np.array([1.0, -2.0, 0.5]))]

    def whole(start, lane):
        return jax.lax.scan(lambda c, n: (body(n, c, lane, uniform), None), start, jnp.arange(float(steps)))[0]

    for j in range(count):
        one = jax.tree.map(lambda leaf, j=j: leaf[j], (start, lane))
        wanted, pull = jax.vjp(whole, *one)
        np.testing.assert_allclose([e[j] for e in end], wanted, rtol=1e-10)
        for found, weight in zip(loop.pull(trail, weights, lane, uniform), weights, strict=True):
            by = pull(tuple(jnp.asarray(w[j]) for w in weight))
            np.testing.assert_allclose([leaf[j] for leaf in jax.tree.leaves(found)], jax.tree.leaves(by), rtol=1e-8)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_work_is_shared_and_failures_end_it(threads):
    """Every task is done once; one that fails is heard of here, and hardly any is begun after it."""
    done = []
    each(done.append, range(100), threads)
    assert sorted(done) == list(range(100))

    begun = []

    def fail_at_ten(task):
        begun.append(task)
        if task == 10:
            raise ValueError("ten")

    with pytest.raises(ValueError, match="ten"):
        each(fail_at_ten, range(100_000), threads)
    assert 10 in begun and len(begun) < 100_000
    each(done.append, [], threads)
