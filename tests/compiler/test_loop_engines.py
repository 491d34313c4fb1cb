"""Loop engines: what a loop computes on each of them, which of them serves, and what is said of the others."""

import dataclasses
import subprocess
import sys
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.compiler import engines
from edhas_jax.compiler.engines import EngineError, EngineFallback, compile_adjoint_loop, compile_loop, engine_statuses
from edhas_jax.compiler.loop_engine import LoopBody, Untranslatable
from edhas_jax.compiler.native_engine import NativeEngine
from edhas_jax.compiler.threads import run_threaded
from edhas_jax.compiler.xla_engine import CHECKPOINT_STEPS, SAMPLES_PER_CALL
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.simulation.integrator import step
from tests.support import ROOT

EPS = {"float32": 2.0**-23, "float64": 2.0**-52}
HAS_NATIVE = not NativeEngine().unavailable()
needs_native = pytest.mark.skipif(not HAS_NATIVE, reason=f"no native engine here: {NativeEngine().unavailable()}")


def decay(n, carry, lane, uniform):
    """Two states that depend on the number of the step, on the lane and on what is uniform."""
    x = carry["x"] * (1.0 - lane["rate"] * uniform["h"]) + jnp.sin(0.1 * n)
    return {"x": x, "steps": carry["steps"] + 1.0}


def decay_body(dtype) -> LoopBody:
    return LoopBody(decay, dtype, {"x": 0.0, "steps": 0.0}, {"rate": 0.0}, {"h": 0.0})


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("dtype", EPS)
@pytest.mark.parametrize("lanes", [1, 7, 33, 200])
def test_a_loop_counts_its_steps_and_keeps_the_samples(dtype, lanes):
    rate = np.linspace(0.0, 3.0, lanes)
    loop = compile_loop(decay_body(dtype))
    start = {"x": np.ones(lanes), "steps": np.zeros(lanes)}
    result = loop.run(start, {"rate": rate}, {"h": 0.01}, 5, 3, 4)
    x, expected = np.ones(lanes), []
    for n in range(12):
        if n % 3 == 0:
            expected.append(x)
        x = x * (1.0 - rate * 0.01) + np.sin(0.1 * (5 + n))
    np.testing.assert_allclose(result.samples["x"], expected, rtol=40 * EPS[dtype], atol=40 * EPS[dtype])
    np.testing.assert_allclose(result.carry["x"], x, rtol=40 * EPS[dtype], atol=40 * EPS[dtype])
    np.testing.assert_array_equal(result.samples["steps"], np.repeat([[0.0], [3.0], [6.0], [9.0]], lanes, axis=1))
    again = loop(start, {"rate": rate}, {"h": 0.01}, 5, 12, threads=3)
    np.testing.assert_allclose(again["x"], result.carry["x"], rtol=4 * EPS[dtype])


@pytest.mark.usefixtures("engine")
def test_more_samples_than_one_call_holds():
    """The sum of 0, 1, 2, … at every sample, over the boundary between two calls of one program."""
    samples = SAMPLES_PER_CALL + 9
    loop = compile_loop(LoopBody(lambda n, c, lane, uniform: c + n, float, 0.0, {}, ()))
    kept = loop.run(np.zeros(3), {}, (), 0, 2, samples).samples
    steps = 2.0 * np.arange(samples)
    np.testing.assert_array_equal(kept, np.repeat((steps * (steps - 1.0) / 2.0)[:, None], 3, axis=1))


@pytest.mark.usefixtures("engine")
def test_inputs_change_from_sample_to_sample():
    def body(n, carry, lane, uniform, here):
        return {"x": carry["x"] + lane["k"] * here["a"] + here["b"]}

    loop = compile_loop(LoopBody(body, float, {"x": 0.0}, {"k": 0.0}, (), sample_inputs={"a": 0.0, "b": 0.0}))
    a, b, k = np.array([1.0, 2.0, 4.0]), np.array([0.0, 10.0, 0.0]), np.arange(20.0)
    got = loop.run({"x": np.zeros(20)}, {"k": k}, (), 0, 5, 3, sample_inputs={"a": a, "b": b})
    np.testing.assert_allclose(got.samples["x"][1:], [5 * k, 15 * k + 50])
    np.testing.assert_allclose(got.carry["x"], 35 * k + 50)


@pytest.mark.usefixtures("engine")
def test_a_lane_does_not_depend_on_its_place_or_its_neighbours():
    rng = np.random.default_rng(0)
    rate = rng.random(100)
    loop = compile_loop(decay_body("float32"))

    def run(some):
        return loop({"x": some, "steps": 0.0 * some}, {"rate": some}, {"h": 0.01}, 0, 50)["x"]

    whole, order = run(rate), rng.permutation(100)[:37]
    np.testing.assert_array_equal(run(rate[order]), whole[order])
    spoilt = rate.copy()
    spoilt[3] = np.nan
    np.testing.assert_array_equal(np.delete(run(spoilt), 3), np.delete(whole, 3))


@pytest.mark.usefixtures("engine")
def test_another_structure_is_refused():
    loop = compile_loop(decay_body(float))
    with pytest.raises(ValueError, match="compiled for lane"):
        loop({"x": np.ones(2), "steps": np.ones(2)}, {"speed": np.ones(2)}, {"h": 0.01}, 0, 1)


def pump_body(dtype, machine, start) -> LoopBody:
    def body(n, y, lane, uniform):
        return step(set_parameters(uniform[0], lane), y, n * uniform[1], uniform[1])[0]

    return LoopBody(body, dtype, dict.fromkeys(start, 0.0), {"piston_diameter": 0.0}, (machine, 0.0))


@needs_native
@pytest.mark.parametrize("dtype", EPS)
def test_the_number_of_vectors_changes_no_bit(dtype):
    machine = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), edhas.PumpBench(effects=(LugreFriction(),)))
    start = {n: np.full(70, v, dtype) for n, v in machine.initial_state().items()}
    diameter = {"piston_diameter": np.linspace(8e-3, 15e-3, 70, dtype=dtype)}
    bodies = [dataclasses.replace(pump_body(dtype, machine, start), vectors=vectors) for vectors in (1, 2, 4)]
    one, *others = [compile_loop(body)(start, diameter, (machine, 2e-5), 0, 800) for body in bodies]
    for other in others:
        jax.tree.map(np.testing.assert_array_equal, other, one)


@pytest.mark.usefixtures("engine")
def test_the_step_of_a_pump_is_that_of_a_plain_jax_loop():
    machine = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    start = {n: float(v) for n, v in machine.initial_state().items()}
    diameter, h = np.linspace(8e-3, 15e-3, 20), 20e-6
    body = pump_body(float, machine, start)
    lanes = {n: np.full(20, v) for n, v in start.items()}
    got = compile_loop(body)(lanes, {"piston_diameter": diameter}, (machine, h), 0, 1500)

    def one(d):
        values = {"piston_diameter": d}
        y = {n: jnp.asarray(v) for n, v in start.items()}
        return jax.lax.fori_loop(0, 1500, lambda n, y: body.step(n * 1.0, y, values, (machine, h)), y)

    expected = jax.jit(jax.vmap(one))(diameter)
    for name in start:
        scale = np.abs(expected[name]).max()
        np.testing.assert_allclose(got[name], expected[name], rtol=0, atol=1e-10 * scale, err_msg=name)


@pytest.mark.usefixtures("engine")
def test_derivatives_pass_through():
    def f(x):
        return jnp.tanh(x) + jnp.exp(-x * x) / (1.0 + jnp.sqrt(x)) + jnp.maximum(x, 1.0) ** 2.5

    def body(n, carry, lane, uniform):
        return dict(zip(("y", "dy"), jax.jvp(f, (lane["x"],), (jnp.ones_like(lane["x"]),)), strict=True))

    x = np.linspace(0.2, 3.0, 40)
    loop = compile_loop(LoopBody(body, float, {"y": 0.0, "dy": 0.0}, {"x": 0.0}, ()))
    got = loop({"y": 0 * x, "dy": 0 * x}, {"x": x}, (), 0, 1)
    np.testing.assert_allclose(got["dy"], jax.vmap(jax.grad(f))(x), rtol=1e-13)


@pytest.mark.usefixtures("engine")
def test_reverse_mode():
    """The cotangents are those of reverse mode through the same steps, wherever the checkpoints fall."""

    def body(n, carry, lane, uniform):
        x, v = carry
        force = -lane["k"] * x - uniform * v * jnp.abs(v) + jnp.sin(0.1 * n)
        return x + 0.05 * v, v + 0.05 * jnp.where(x > 0.5, 2.0 * force, force)

    steps, count = 8 * CHECKPOINT_STEPS + 7, 3  # two whole segments of the native engine, eight of XLA's
    start = np.linspace(0.2, 0.9, count), np.linspace(-1.0, 1.0, count)
    lane, uniform = {"k": np.array([1.0, 2.0, 3.0])}, 0.3
    loop = compile_adjoint_loop(LoopBody(body, float, (0.0, 0.0), {"k": 0.0}, 0.0))
    end, checkpoints = loop.run(start, lane, uniform, steps)
    weights = [(np.ones(count), np.zeros(count)), (np.zeros(count), np.array([1.0, -2.0, 0.5]))]
    found = loop.vjp(checkpoints, weights, lane, uniform)

    def whole(start, lane):
        return jax.lax.scan(lambda c, n: (body(n, c, lane, uniform), None), start, jnp.arange(float(steps)))[0]

    for j in range(count):
        one = jax.tree.map(lambda leaf, j=j: leaf[j], (start, lane))
        expected, pull = jax.vjp(whole, *one)
        np.testing.assert_allclose([e[j] for e in end], expected, rtol=1e-10)
        for by, weight in zip(found, weights, strict=True):
            right = pull(tuple(jnp.asarray(w[j]) for w in weight))
            np.testing.assert_allclose([leaf[j] for leaf in jax.tree.leaves(by)], jax.tree.leaves(right), rtol=1e-8)


@pytest.mark.parametrize("threads", [1, 2, 7])
def test_work_is_shared_and_failures_end_it(threads):
    """Every task is done once; a failure is raised by the caller, and hardly any task is begun after it."""
    done = []
    run_threaded(done.append, range(100), threads)
    assert sorted(done) == list(range(100))

    begun = []

    def fail_at_ten(task):
        begun.append(task)
        if task == 10:
            raise ValueError("ten")

    with pytest.raises(ValueError, match="ten"):
        run_threaded(fail_at_ten, range(100_000), threads)
    assert 10 in begun and len(begun) < 100_000
    run_threaded(done.append, [], threads)


@pytest.fixture
def nothing_said(monkeypatch):
    monkeypatch.setattr(engines, "_said", set())
    monkeypatch.delenv("EDHAS_ENGINE", raising=False)


@needs_native
def test_a_body_that_the_native_engine_cannot_run_goes_to_xla_and_that_is_said_once(nothing_said):
    body = LoopBody(lambda n, c, lane, uniform: jnp.arctan2(c, lane), float, 0.0, 0.0, ())
    with pytest.raises(Untranslatable, match="atan2"):
        NativeEngine().compile(body)
    with pytest.warns(EngineFallback, match="the native engine cannot run.*atan2.*XLA serves instead"):
        loop = compile_loop(body)
    np.testing.assert_allclose(loop(np.ones(3), np.full(3, 2.0), (), 0, 1), np.arctan2(1.0, 2.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        compile_loop(body)


@needs_native
def test_a_batch_with_an_untranslatable_primitive_equals_that_of_xla(nothing_said, monkeypatch):
    """As when JAX renames a primitive: results are those of XLA, and one sentence says why."""
    from edhas_jax.compiler import jaxpr_to_ir

    table = {"mover_mass": np.array([0.11, 0.15])}
    machine, settings = edhas.ActuatorBench(effects=(LugreFriction(),)), BatchSettings(step=1e-4)
    with monkeypatch.context() as patch:
        patch.setenv("EDHAS_ENGINE", "xla")
        expected = run_designs(machine, table, settings)
    monkeypatch.setenv("EDHAS_CACHE", "off")
    from edhas_jax.simulation import loop_cache

    loop_cache._made.cache_clear()
    monkeypatch.setattr(jaxpr_to_ir, "_RULES", {n: r for n, r in jaxpr_to_ir._RULES.items() if n != "mul"})
    with pytest.warns(EngineFallback, match="the operation `mul`"):
        got = run_designs(machine, table, settings)
    loop_cache._made.cache_clear()
    for name in expected:
        np.testing.assert_array_equal(got[name], expected[name], err_msg=name)


def test_the_engine_that_is_asked_for_serves(engine):
    rows = {row.name: row for row in engine_statuses()}
    assert rows[engine].serves and rows[engine].reason == f"EDHAS_ENGINE={engine}"
    assert sum(row.serves for row in rows.values()) == 1 and all(row.reason for row in rows.values())


def test_an_engine_that_is_not_there_is_an_error(monkeypatch):
    monkeypatch.setenv("EDHAS_ENGINE", "abacus")
    with pytest.raises(EngineError, match="EDHAS_ENGINE=abacus: there is no such engine; one of gpu, native, xla"):
        engines.serving_engine()


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        ("sys.modules['llvmlite'] = None", "llvmlite cannot be imported"),
        (
            "from llvmlite import binding\n"
            "def unknown(): raise RuntimeError('host CPU unknown')\n"
            "binding.get_host_cpu_features = unknown",
            "LLVM does not know this processor",
        ),
    ],
)
def test_without_llvm_xla_serves_and_says_so_once(spoil, says):
    code = (
        f"import sys\n{spoil}\n"
        "import edhas_jax as edhas, numpy as np\n"
        "from edhas_jax.design.batch.batch import BatchSettings, run_designs\n"
        "table = {'mover_mass': np.array([0.11, 0.15])}\n"
        "for _ in range(2):\n"
        "    got = run_designs(edhas.ActuatorBench(), table, BatchSettings(step=1e-4))\n"
        "print(*(float(v).hex() for v in got['rms_current']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("EngineFallback") == 1 and says in done.stderr
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EDHAS_ENGINE", "xla")
        table = {"mover_mass": np.array([0.11, 0.15])}
        expected = run_designs(edhas.ActuatorBench(), table, BatchSettings(step=1e-4))["rms_current"]
    assert [float.fromhex(v) for v in done.stdout.split()] == list(expected)
