"""The GPU as a loop engine: when it serves, and whole tasks on it, on a driver with devices in host memory."""

import dataclasses
import json
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.compiler import engines
from edhas_jax.compiler.engines import EngineError, compile_adjoint_loop, compile_loop, engine_statuses, many_lanes
from edhas_jax.compiler.gpu.adjoint import SEGMENT_STEPS, GpuAdjointLoop
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, Device
from edhas_jax.compiler.gpu.loop import GpuLoop
from edhas_jax.compiler.gpu.rates import MARGIN, estimated_rates
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.native_loop import NativeLoop
from edhas_jax.design.batch.batch import BatchSettings, engine_of_designs, plan_chunks, run_designs
from edhas_jax.design.batch.periodic_solver import GPU_TABLE
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.forward import forward
from edhas_jax.design.gradient.reverse import reverse
from edhas_jax.design.sweep.identity import device, versions
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.simulation.batch_trajectories import simulate_batch
from edhas_jax.simulation.run_settings import Precision
from tests.compiler.test_loop_engines import EPS, decay_body
from tests.support.fake_cuda import FakeCuda, fake_engine

H100 = Device(0, "H100", (9, 0), 132, 1.98e9)
CARD = Device(0, "RTX 4070", (8, 9), 46, 2.475e9)


@pytest.fixture
def gpu(monkeypatch):
    """The fake library of the GPU engine, which is asked for."""
    cuda = FakeCuda()
    fake_engine(monkeypatch, cuda)
    monkeypatch.setenv("EDHAS_ENGINE", "gpu")
    return cuda


@pytest.fixture
def offered(monkeypatch):
    """`offered(**device)`: the GPU engine is there and nothing is asked for."""
    monkeypatch.delenv("EDHAS_ENGINE", raising=False)
    monkeypatch.setattr(engines, "_said", set())
    return lambda **given: fake_engine(monkeypatch, FakeCuda(**given))


def test_an_estimate_says_who_is_faster():
    """A card for computing wins in both precisions, one with few units for float64 in float32 alone."""
    assert 500 < estimated_rates([H100], 16, 32, "float32").least_lanes() < 5000
    assert 200 < estimated_rates([H100], 16, 32, "float64").least_lanes() < 5000
    assert estimated_rates([CARD], 16, 32, "float32").least_lanes() is not None
    assert estimated_rates([CARD], 16, 32, "float64").least_lanes() is None
    one, four = (estimated_rates([H100] * n, 16, 32, "float32") for n in (1, 4))
    assert four.full == 4 * one.full and four.least_lanes() == one.least_lanes()
    least = one.least_lanes()
    assert least * one.one_lane >= MARGIN * one.processor > (least - 1) * one.one_lane


def test_a_gpu_takes_large_batches_and_the_processor_the_rest(offered):
    engine = offered(multiprocessors=132)
    rows = {row.name: row for row in engine_statuses()}
    least = engine.rates("float32").least_lanes()
    assert rows["gpu"].serves and rows["native"].serves and not rows["xla"].serves
    assert f"float32 from {least:,} designs on" in rows["gpu"].reason and "1 × Fake GPU" in rows["gpu"].reason
    assert "not measured" in rows["gpu"].reason
    assert many_lanes(least, "float32") and not many_lanes(least - 1, "float32")
    assert engines.serving_engine(True).name == "gpu" and engines.serving_engine(False).name == "native"
    for many, kind in ((True, GpuLoop), (False, NativeLoop)):
        assert type(compile_loop(dataclasses.replace(decay_body("float32"), many_lanes=many))) is kind


def test_a_gpu_with_few_units_for_float64_says_none(offered, monkeypatch):
    monkeypatch.setenv("EDHAS_CORES", "64")
    engine = offered(multiprocessors=132, capability=(8, 9))
    assert "in float64 none" in engine.description() and not many_lanes(10**9, "float64")


def test_without_a_gpu_nothing_is_said(monkeypatch, offered):
    offered(count=0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert engines.serving_engine(True).name == "native" and not many_lanes(10**9, "float32")
    rows = {row.name: row for row in engine_statuses()}
    assert not rows["gpu"].serves and rows["gpu"].reason == "the driver shows no GPU"
    monkeypatch.setenv("EDHAS_ENGINE", "gpu")
    with pytest.raises(EngineError, match="EDHAS_ENGINE=gpu: this engine cannot serve here: the driver shows no GPU"):
        engines.serving_engine()


def test_a_step_that_does_not_fit_the_registers_stays_on_the_processor_unless_a_gpu_is_asked_for(offered, monkeypatch):
    offered(multiprocessors=132, local_bytes=lambda registers: 9000)
    body = LoopBody(lambda n, c, lane, uniform: c + 1.0, "float32", 0.0, {}, (), many_lanes=True)
    assert type(compile_loop(body)) is NativeLoop
    with monkeypatch.context() as patch:
        patch.setenv("EDHAS_ENGINE", "gpu")
        assert type(compile_loop(body)) is GpuLoop
    # nor where only XLA would follow
    monkeypatch.setattr(type(engines.NATIVE), "unavailable", lambda self: "JAX computes on an accelerator here")
    assert many_lanes(1, "float32") and type(compile_loop(body)) is GpuLoop


def test_the_command_says_why_a_gpu_serves(offered, capsys):
    offered(multiprocessors=132)
    assert main(["device", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)["engines"]}
    assert rows["gpu"]["serves"] and "estimated for 1 × Fake GPU, not measured" in rows["gpu"]["reason"]


@pytest.mark.parametrize(
    ("given", "says"), [({"memory": 3000}, "out of memory"), ({"breaks": True}, "illegal address")]
)
def test_a_command_tells_the_error_of_a_gpu_in_a_line(given, says, monkeypatch, offered, tmp_path, capsys):
    offered(**given)
    monkeypatch.setenv("EDHAS_ENGINE", "gpu")
    assert main(["sweep", "configs/sweep_clearance.yaml", "--out", str(tmp_path / "sweep")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert line.startswith("edhas: GPU: cu") and says in line


def test_loops_of_one_lane_and_with_arrays_go_to_others(gpu):
    single = LoopBody(lambda n, c, lane, uniform: c + n, float, 0.0, {}, (), single_lane=True)
    array = LoopBody(lambda n, c, lane, u: c + u.sum(), float, 0.0, {}, np.ones(3))
    assert type(compile_loop(single)) is NativeLoop
    assert type(compile_loop(array)) is not GpuLoop and not gpu.launches


def test_reverse_mode(gpu):
    """The cotangents are those of reverse mode through the same steps, wherever the checkpoints fall."""

    def body(n, carry, lane, uniform):
        x, v = carry
        force = -lane["k"] * x - uniform * v * jnp.abs(v) + jnp.sin(0.1 * n)
        return x + 0.05 * v, v + 0.05 * jnp.where(x > 0.5, 2.0 * force, force)

    count, lane, uniform = 40, {"k": np.linspace(1.0, 3.0, 40)}, 0.3
    start = np.linspace(0.2, 0.9, count), np.linspace(-1.0, 1.0, count)
    loop = compile_adjoint_loop(LoopBody(body, float, (0.0, 0.0), {"k": 0.0}, 0.0))
    assert type(loop) is GpuAdjointLoop
    weights = [(np.ones(count), np.zeros(count)), (np.zeros(count), np.linspace(-2.0, 1.0, count))]
    for steps in (3, SEGMENT_STEPS, 2 * SEGMENT_STEPS + 7):

        def whole(start, lane, steps=steps):
            return jax.lax.scan(lambda c, n: (body(n, c, lane, uniform), None), start, jnp.arange(float(steps)))[0]

        end, checkpoints = loop.run(start, lane, uniform, steps)
        found = loop.vjp(checkpoints, weights, lane, uniform)
        expected, pull = jax.vjp(jax.vmap(whole), *jax.tree.map(jnp.asarray, (start, lane)))
        np.testing.assert_allclose(end, expected, rtol=1e-10)
        for by, weight in zip(found, weights, strict=True):
            jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-8), by, pull(weight))
    assert not gpu.blocks


def test_reverse_mode_in_halves_and_on_two_devices(monkeypatch):
    def body(n, carry, lane, uniform):
        return carry + 0.01 * jnp.sin(lane["k"] * carry)

    lane, w, results = {"k": np.linspace(1.0, 3.0, 500)}, [np.ones(500)], []
    for given in ({}, {"memory": 400_000}, {"count": 2, "multiprocessors": 2}):
        cuda = FakeCuda(**given)
        loop = fake_engine(monkeypatch, cuda).compile_adjoint(LoopBody(body, float, 0.0, {"k": 0.0}, ()))
        _, checkpoints = loop.run(np.ones(500), lane, (), 150)
        results.append(loop.vjp(checkpoints, w, lane, ()))
        assert not cuda.blocks
    jax.tree.map(np.testing.assert_array_equal, *results[:2])
    jax.tree.map(np.testing.assert_array_equal, *results[1:])


MACHINE = edhas.PumpBench(effects=(LugreFriction(),))
TABLE = {"piston_diameter": np.linspace(9e-3, 13e-3, 40), "frequency": np.resize([15.0, 20.0], 40)}


@pytest.mark.parametrize("precision", Precision)
def test_a_batch_is_that_of_the_native_engine_to_rounding(gpu, monkeypatch, precision):
    settings = BatchSettings(step=5e-5, precision=precision)
    chunks = plan_chunks(MACHINE, TABLE, settings)
    assert all(chunk.many_lanes for chunk in chunks) and GPU_TABLE > 50_000
    found = run_designs(MACHINE, TABLE, settings)
    assert gpu.launches and engine_of_designs(MACHINE, TABLE, precision, True) == "gpu"
    assert versions("gpu")["engine"] == "gpu" and device("gpu")["device"] == "1 × Fake GPU"
    monkeypatch.setenv("EDHAS_ENGINE", "native")
    assert not any(chunk.many_lanes for chunk in plan_chunks(MACHINE, TABLE, settings))
    expected = run_designs(MACHINE, TABLE, settings)
    np.testing.assert_array_equal(found["status"], expected["status"])
    # contacts of the valves enlarge a difference in rounding; a design counts as periodic at 1e-4
    rtol = {"float32": 1e-3, "float64": 1e-7}[precision.value]
    for name in ("mean_flow", "mean_electrical_power", "rms_current"):
        np.testing.assert_allclose(found[name], expected[name], rtol=rtol, err_msg=name)


def test_the_result_names_the_engine_that_made_it(monkeypatch, offered, tmp_path):
    """Of a GPU that is asked for, but whose driver compiles no kernel: not that GPU."""
    monkeypatch.setenv("EDHAS_ENGINE", "gpu")
    settings = BatchSettings(step=2e-4, max_cycles=2, precision=Precision.FLOAT32)
    for knows, name in ((True, "gpu"), (False, "native")):
        engine = offered()
        if not knows:
            monkeypatch.setattr(engine, "_load", lambda: CudaDriver(FakeCuda()))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", engines.EngineFallback)
            found = edhas.sweep(MACHINE, frequency=[15.0, 20.0], settings=settings, folder=tmp_path / name)
        assert found.attrs["engine"] == name
        manifest = json.loads((tmp_path / name / "manifest.json").read_text())
        assert manifest["engine"] == name and ("Fake GPU" in manifest["computed_on"][0]["device"]) is knows


def test_trajectories_are_those_of_the_native_engine(gpu, monkeypatch):
    values = {"piston_diameter": np.linspace(9e-3, 13e-3, 6)}
    seeds = {"piston_diameter": np.ones(6)}
    arguments = MACHINE, values, seeds, 2e-5, 20, np.array([30, 30, 30, 10, 30, 30]), ("outlet_flow", "current")
    found = simulate_batch(*arguments)
    assert gpu.launches
    monkeypatch.setenv("EDHAS_ENGINE", "native")
    expected = simulate_batch(*arguments)
    for part, right in zip(found, expected, strict=True):
        for name, column in right.items():
            limit = 1e-9 * np.nanmax(np.abs(column))
            np.testing.assert_allclose(part[name], column, rtol=0.0, atol=limit, err_msg=name)


def test_derivatives_are_those_of_the_native_engine(gpu, monkeypatch):
    columns = {n: v[:9] for n, v in TABLE.items()}
    names, settings = ("piston_diameter", "frequency"), GradientSettings(steps_per_cycle=1024)
    arguments = MACHINE, columns, names, ("mean_flow",), settings
    found = forward(*arguments), reverse(*arguments)
    assert gpu.launches
    monkeypatch.setenv("EDHAS_ENGINE", "native")
    expected = forward(*arguments)
    for part in found:
        np.testing.assert_allclose(part.values["mean_flow"], expected.values["mean_flow"], rtol=1e-8)
        np.testing.assert_allclose(part.slopes["mean_flow"], expected.slopes["mean_flow"], rtol=1e-3)


@pytest.mark.parametrize("dtype", EPS)
def test_a_lane_does_not_depend_on_its_place_or_its_neighbours(gpu, dtype):
    rate = np.random.default_rng(0).random(100)
    loop = compile_loop(decay_body(dtype))
    run = lambda some: loop({"x": some, "steps": 0.0 * some}, {"rate": some}, {"h": 0.01}, 0, 50)["x"]  # noqa: E731
    whole, order = run(rate), np.random.default_rng(1).permutation(100)[:37]
    np.testing.assert_array_equal(run(rate[order]), whole[order])
