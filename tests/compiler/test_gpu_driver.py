"""What is said where a driver is missing, is too old or refuses a kernel."""

import ctypes
import re

import pytest

from edhas_jax.compiler.gpu.cuda_driver import LEAST_CUDA, UNKNOWN_CLOCK, CudaDriver, load_driver
from edhas_jax.compiler.gpu.engine import GpuEngine
from edhas_jax.compiler.gpu.ptx import ptx
from edhas_jax.compiler.loop_engine import Untranslatable
from tests.compiler.test_loop_engines import decay_body
from tests.support.fake_cuda import FakeCuda


def test_what_the_driver_says_of_a_kernel_it_cannot_compile():
    engine = GpuEngine(lambda: CudaDriver(FakeCuda()))  # it knows no kernel
    with pytest.raises(Untranslatable, match=r"GPU: cuModuleLoadDataEx: invalid image \(200\): ptxas: syntax"):
        engine.compile(decay_body(float))


def test_without_a_driver_the_engine_says_so(monkeypatch):
    def missing(name):
        raise OSError(name)

    monkeypatch.setattr(ctypes, "CDLL", missing)
    load_driver.cache_clear()
    try:
        assert GpuEngine().unavailable() in ("no NVIDIA driver (libcuda.so.1)", "no NVIDIA driver (nvcuda.dll)")
    finally:
        load_driver.cache_clear()


@pytest.mark.parametrize(
    ("device", "says"),
    [
        ({"count": 0}, "the driver shows no GPU"),
        ({"capability": (6, 1)}, "all GPUs are older than compute capability 7.0"),
        ({"cuda": (10, 2)}, "the NVIDIA driver is for CUDA 10.2; one for CUDA 11.0 or later is needed"),
    ],
)
def test_a_driver_without_a_usable_gpu(device, says):
    assert GpuEngine(lambda: CudaDriver(FakeCuda(**device))).unavailable() == says


def test_a_driver_that_lacks_a_function(monkeypatch):
    """As the library has it that stands in for a driver where programs are only built."""
    monkeypatch.delattr(FakeCuda, "cuDeviceGetCount")
    assert GpuEngine(lambda: CudaDriver(FakeCuda())).unavailable() == (
        "the NVIDIA driver has no function cuDeviceGetCount"
    )


def test_a_driver_without_the_clock_rate(monkeypatch):
    ask = FakeCuda.cuDeviceGetAttribute
    monkeypatch.setattr(FakeCuda, "cuDeviceGetAttribute",
                        lambda self, value, name, device: 1 if name.value == 13 else ask(self, value, name, device))
    found = CudaDriver(FakeCuda()).devices()
    assert [device.clock for device in found] == [UNKNOWN_CLOCK]


def test_the_driver_reads_the_version_of_ptx_that_is_written():
    """PTX ISA 7.0 came with CUDA 11.0 (PTX ISA, release notes)."""
    for name in ("sm_70", "sm_80"):
        (version,) = re.findall(r"^\.version (\d+)\.(\d+)$", ptx(EMPTY, name), re.MULTILINE)
        assert (int(version[0]), int(version[1])) <= (7, 0) and LEAST_CUDA == (11, 0)


EMPTY = """target triple = "nvptx64-nvidia-cuda"
define ptx_kernel void @run() {
  ret void
}
"""
