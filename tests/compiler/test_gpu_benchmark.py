"""The benchmark of the kernels runs through where a GPU is there, on a driver with devices in host memory."""

import dataclasses
import importlib.util
import math
import sys

import jax
import numpy as np
import pytest

from edhas_jax.compiler.gpu.cuda_driver import Device
from tests.support import ROOT
from tests.support.fake_cuda import FakeCuda, fake_engine


def _module(name):
    """A module of the folder of benchmarks."""
    spec = importlib.util.spec_from_file_location(name, ROOT / "benchmarks" / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def benchmark():
    return _module("gpu")


def test_the_measurement_covers_both_precisions(benchmark, monkeypatch, capsys):
    fake_engine(monkeypatch, FakeCuda())
    headline = benchmark.speeds([32, 64], 32)
    printed = capsys.readouterr().out
    assert "1 × Fake GPU" in printed and printed.count("float32") == printed.count("float64") == 2
    assert headline["gpu"] == "Fake_GPU" and headline["over_xla_float32"] == "nan"
    assert all(float(headline[n]) > 0.0 for n in ("gpu_float32", "gpu_float64", "over_processor_float64"))


@pytest.fixture
def tasks():
    return _module("gpu_tasks")


def test_whole_tasks_are_measured_and_compared(tasks, monkeypatch):
    fake_engine(monkeypatch, FakeCuda())
    monkeypatch.setattr(tasks, "SETTINGS", dataclasses.replace(tasks.SETTINGS, step=1e-4))
    monkeypatch.setattr(tasks, "STEPS", 32)
    found = tasks.tasks(40)
    assert found["same_bits_in_any_order"] == "1" and float(found["mean_flow_differs"]) < 1e-3
    assert all(float(found[name]) > 0.0 for name in ("beside_kernels_s", "periodic_s", "forward_over_plain"))


def test_tasks_without_a_gpu(tasks, monkeypatch, capsys):
    fake_engine(monkeypatch, FakeCuda(count=0))
    assert tasks.tasks(40).keys() == {"beside_kernels_s"}
    assert "nothing was measured on a GPU: the driver shows no GPU" in capsys.readouterr().out


@pytest.fixture
def peers(monkeypatch):
    """The comparison with cubie and diffrax; its settings of JAX end with the test."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    before = jax.config.jax_enable_x64
    yield importlib.import_module("gpu_peers")
    jax.config.update("jax_enable_x64", before)
    for name in ("gpu_peers", "peers", "c_loop"):
        sys.modules.pop(name, None)


def test_the_equations_for_cubie_are_those_of_the_bench(peers):
    """Evaluated one after the other they give the rates of the package."""
    equations, initial, parameters = peers.model()
    rng = np.random.default_rng(0)
    states = {z: v + 0.1 * rng.random() for z, v in initial.items()}
    given = {p: peers.c_loop.VARIED[n][1] for p, n in parameters.items()}
    known = {"Max": max, "Min": min, "Abs": abs, "sqrt": math.sqrt, "exp": math.exp, "log": math.log, "sin": math.sin,
             "cos": math.cos, **states, **given, "t": 0.013}  # fmt: skip
    for equation in equations:
        name, text = equation.split(" = ", 1)
        known[name] = eval(text, {}, known)
    names = [*sorted(peers.start()), peers.FLOW]
    y = dict(zip(names, states.values(), strict=True))
    right = peers.scaled_rates({parameters[p]: v for p, v in given.items()}, y, 0.013)
    found = [known[f"d{z}"] for z in states]
    np.testing.assert_allclose(found, [right[n] for n in names], rtol=1e-9)
    assert sum(abs(rate) > 0.0 for rate in found) > 12


def test_what_cannot_run_is_said_in_a_sentence(peers, monkeypatch, capsys):
    fake_engine(monkeypatch, FakeCuda(count=0))
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None if name == "cubie" else name)
    assert peers.factors(2) == {"over_cubie": "skipped", "over_diffrax": "skipped"}
    assert capsys.readouterr().out.splitlines() == [
        "  package was not run: the driver shows no GPU",
        "  diffrax was not run: the driver shows no GPU",
        "  cubie was not run: cubie is not installed",
    ]


def test_the_comparison_runs_the_package_on_the_gpu(peers, monkeypatch, capsys):
    cuda = FakeCuda()
    fake_engine(monkeypatch, cuda)
    monkeypatch.setattr(peers.peers, "STEPS", (100e-6,))
    monkeypatch.setattr(peers.peers, "ALLOWED", 0.1)
    monkeypatch.setattr(peers, "reference", lambda values, steps: np.full(2, 1.7e-5))
    monkeypatch.setattr(peers.importlib.util, "find_spec", lambda name: None)
    assert peers.compare(2, tiny=False).keys() == {"package"} and cuda.launches
    assert "cubie was not run: cubie is not installed" in capsys.readouterr().out


def test_the_bound_counts_the_slower_units_of_float64(benchmark):
    card = Device(0, "card", (8, 9), 10, 1e9)
    assert benchmark.bound(card, "float32", 1000, 0) == 10 * 128 * 1e9 / 1000
    assert benchmark.bound(card, "float64", 2000, 1000) == 10 * 2 * 1e9 / 1000
    # where every instruction has to be issued, that is the limit
    assert benchmark.bound(card._replace(capability=(9, 0)), "float64", 3000, 1000) == 10 * 128 * 1e9 / 3000
