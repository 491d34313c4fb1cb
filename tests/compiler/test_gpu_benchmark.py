"""The benchmark of the kernels runs through where a GPU is there, on a driver with devices in host memory."""

import importlib.util

import pytest

from edhas_jax.compiler.gpu.cuda_driver import Device
from tests.support import ROOT
from tests.support.fake_cuda import FakeCuda, fake_engine


@pytest.fixture
def benchmark():
    spec = importlib.util.spec_from_file_location("gpu_benchmark", ROOT / "benchmarks" / "gpu.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_measurement_covers_both_precisions(benchmark, monkeypatch, capsys):
    fake_engine(monkeypatch, FakeCuda())
    headline = benchmark.speeds([32, 64], 32)
    printed = capsys.readouterr().out
    assert "1 × Fake GPU" in printed and printed.count("float32") == printed.count("float64") == 2
    assert headline["gpu"] == "Fake_GPU" and headline["over_xla_float32"] == "nan"
    assert all(float(headline[n]) > 0.0 for n in ("gpu_float32", "gpu_float64", "over_processor_float64"))


def test_the_bound_counts_the_slower_units_of_float64(benchmark):
    card = Device(0, "card", (8, 9), 10, 1e9)
    assert benchmark.bound(card, "float32", 1000, 0) == 10 * 128 * 1e9 / 1000
    assert benchmark.bound(card, "float64", 2000, 1000) == 10 * 2 * 1e9 / 1000
    # where every instruction has to be issued, that is the limit
    assert benchmark.bound(card._replace(capability=(9, 0)), "float64", 3000, 1000) == 10 * 128 * 1e9 / 3000
