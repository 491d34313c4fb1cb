"""The launcher end to end, on a driver whose devices are memory of this process."""

import ctypes

import jax
import numpy as np
import pytest

from edhas_jax.compiler.gpu import device_arrays
from edhas_jax.compiler.gpu import loop as gpu_loop
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, CudaError, Device, OutOfDeviceMemory, load_driver
from edhas_jax.compiler.gpu.device_kernel import BLOCK_THREADS, March, launch_size
from edhas_jax.compiler.gpu.engine import GpuEngine
from edhas_jax.compiler.gpu.loop import deal
from edhas_jax.compiler.gpu.memory import DeviceMemory
from edhas_jax.compiler.loop_engine import LoopBody, Untranslatable
from edhas_jax.compiler.native_loop import NativeLoop
from tests.compiler.test_loop_engines import decay_body
from tests.support.fake_cuda import FakeCuda, fake_engine


def decay_lanes(count: int):
    rate = np.linspace(0.0, 3.0, count)
    return {"x": np.ones(count), "steps": np.zeros(count)}, {"rate": rate}, {"h": 0.01}


@pytest.fixture
def made(monkeypatch):
    """`made(body, **device)`: the loop and the driver behind it."""

    def make(body: LoopBody, **device):
        cuda = FakeCuda(**device)
        return fake_engine(monkeypatch, cuda).compile(body), cuda

    return make


@pytest.mark.parametrize("lanes", [1, 31, 32, 33, 5000])
def test_every_lane_is_run_once_and_all_memory_is_given_back(lanes, made):
    loop, cuda = made(decay_body(float))
    found = loop.run(*decay_lanes(lanes), 5, 3, 4)
    expected = NativeLoop(decay_body(float)).run(*decay_lanes(lanes), 5, 3, 4)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    ((device, blocks, threads, count),) = cuda.launches
    assert (device, count) == (0, lanes) and (blocks - 1) * threads < lanes <= blocks * threads
    assert not cuda.blocks and cuda.used == {0: 0}


@pytest.mark.parametrize("keep", [True, False])
def test_sample_inputs_and_an_empty_set_of_lane_values(keep, made):
    def body(n, carry, lane, uniform, here):
        return carry + n * here["a"] + here["b"]

    loop, _ = made(LoopBody(body, float, 0.0, {}, (), sample_inputs={"a": 0.0, "b": 0.0}))
    a, b = np.array([1.0, 2.0, 4.0]), np.array([0.0, 10.0, 0.0])
    found = loop.run(np.zeros(40), {}, (), 7, 2, 3, keep=keep, sample_inputs={"a": a, "b": b})
    sums = np.cumsum([0.0, 7.0 + 8.0, 2 * (9.0 + 10.0) + 20.0, 4 * (11.0 + 12.0)])
    np.testing.assert_array_equal(found.carry, np.full(40, sums[-1]))
    if keep:
        np.testing.assert_array_equal(found.samples, np.repeat(sums[:-1, None], 40, axis=1))
    assert keep or found.samples is None


def test_one_number_stands_for_all_lanes(made):
    loop, _ = made(decay_body(float))
    carry, lane, uniform = decay_lanes(70)
    found = loop({"steps": carry["steps"], "x": 1.0}, lane, uniform, 0, 9)
    jax.tree.map(np.testing.assert_array_equal, found, loop(carry, lane, uniform, 0, 9))


def test_the_block_shrinks_where_large_ones_would_leave_multiprocessors_idle():
    assert launch_size(1_000_000, 132) == (7813, 128)
    assert launch_size(132 * 128, 132) == (132, 128)
    assert launch_size(132 * 128 - 128, 132) == (262, 64)
    assert launch_size(4000, 132) == (125, 32)
    assert launch_size(1, 132) == (1, 32)
    for lanes in (1, 31, 100, 4097, 99_999):
        blocks, threads = launch_size(lanes, 108)
        assert threads in BLOCK_THREADS and (blocks - 1) * threads < lanes <= blocks * threads


def test_lanes_are_dealt_over_the_devices_in_whole_warps():
    large, small = (Device(k, "GPU", (9, 0), count, 1e9) for k, count in enumerate((120, 60)))
    parts = deal([large, small], 90_001)
    assert [part for _, part in parts] == [range(60_032), range(60_032, 90_001)]
    assert deal([large, small], 1000) == [(large, range(1000))]
    (_, first), *_ = parts
    assert len(first) % 32 == 0


def test_several_devices_give_the_same_numbers(made):
    loop, cuda = made(decay_body("float32"), count=3)
    found = loop.run(*decay_lanes(1003), 0, 4, 5)
    expected = NativeLoop(decay_body("float32")).run(*decay_lanes(1003), 0, 4, 5)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    assert sorted(device for device, *_ in cuda.launches) == [0, 1, 2]
    assert sum(lanes for *_, lanes in cuda.launches) == 1003 and not cuda.blocks


def test_a_batch_that_does_not_fit_is_cut_in_halves(made):
    """100 samples of 2 numbers in 8 bytes: 1000 lanes take 1.6 MB, of which the device has a quarter."""
    loop, cuda = made(decay_body(float), memory=400_000)
    found = loop.run(*decay_lanes(1000), 0, 1, 100)
    expected = NativeLoop(decay_body(float)).run(*decay_lanes(1000), 0, 1, 100)
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    counts = [lanes for *_, lanes in cuda.launches]
    assert sum(counts) == 1000 and max(counts) < 250 and all(lanes % 32 == 0 for lanes in counts[:-1])
    assert cuda.most_used <= 400_000 and not cuda.blocks


def test_not_even_a_warp_fits(made):
    loop, cuda = made(decay_body(float), memory=10_000)
    with pytest.raises(OutOfDeviceMemory, match=r"cuMemAlloc_v2: out of memory \(2\)"):
        loop.run(*decay_lanes(1000), 0, 1, 100)
    assert not cuda.blocks


def test_as_few_registers_as_spill_little_are_taken(made):
    spilled = {128: 600, 168: 40, 255: 0}
    loop, cuda = made(decay_body(float), local_bytes=spilled.__getitem__)
    loop(*decay_lanes(3), 0, 1)
    assert [most for _, most in cuda.kernels] == [128, 168]
    loop, cuda = made(decay_body("float32"), local_bytes=lambda most: 600)
    assert [most for _, most in cuda.kernels] == [128, 168, 255]


def test_what_the_driver_says_of_a_kernel_it_cannot_compile():
    engine = GpuEngine(lambda: CudaDriver(FakeCuda()))  # it knows no kernel
    with pytest.raises(Untranslatable, match=r"the driver: cuModuleLoadDataEx: invalid image \(200\): ptxas: syntax"):
        engine.compile(decay_body(float))


def test_steps_beyond_the_counter_are_refused(made):
    loop, _ = made(decay_body(float))
    with pytest.raises(ValueError, match="2,147,483,647"):
        loop(*decay_lanes(3), 2**31 - 5, 10)


def test_a_kernel_that_writes_beside_its_memory_is_found(made):
    """The guards of the fake driver: without them the tests above would prove less."""
    driver = CudaDriver(FakeCuda())
    with pytest.raises(CudaError, match="illegal address"), DeviceMemory(driver, 0) as memory:
        ctypes.memset(memory.new(80) + 80, 0, 1)


class OnDevice:
    """An array in the memory of a fake device."""

    def __init__(self, driver: CudaDriver, device: int, data: np.ndarray, filled: bool = True):
        self.address = driver.allocate(device, data.nbytes)
        if filled:
            driver.upload(device, self.address, data)
        self.shape, self.dtype = data.shape, data.dtype
        self.ndim, self.size = data.ndim, data.size

    @property
    def __cuda_array_interface__(self):
        return {"shape": self.shape, "typestr": self.dtype.str, "data": (self.address, False), "version": 3}


def test_arrays_on_a_device_are_read_and_written_where_they_are(monkeypatch):
    """Nothing of them is copied to the host or back: only the tables of addresses go to the device."""
    cuda = FakeCuda(count=2)
    engine = fake_engine(monkeypatch, cuda)
    loop, driver = engine.compile(decay_body(float)), engine._load()
    carry, lane, uniform = decay_lanes(100)
    expected = loop.run(carry, lane, uniform, 0, 2, 6)
    monkeypatch.setattr(
        gpu_loop, "empty_like", lambda leaf, shape, dtype: OnDevice(driver, 1, np.empty(shape, dtype), filled=False)
    )
    on_device = jax.tree.map(lambda leaf: OnDevice(driver, 1, leaf), (carry, lane))
    copied = []
    write = cuda.cuMemcpyHtoD_v2
    monkeypatch.setattr(cuda, "cuMemcpyHtoD_v2", lambda *a: copied.append(a[2].value) or write(*a))
    monkeypatch.setattr(cuda, "cuMemcpyDtoH_v2", None)
    device = engine.devices()[1]
    leaves = jax.tree.leaves(on_device)
    assert device_arrays.common_device(leaves, 100, np.dtype(float), driver) == 1
    found = loop._on_device(device, leaves, 100, March(0, 2, 6), loop.kernel.constants(uniform), np.empty((0, 6)), True)
    monkeypatch.undo()
    assert sum(copied) <= 8 * len(leaves) and cuda.launches[-1][0] == 1
    final, kept = (driver_read(driver, part) for part in found)
    np.testing.assert_array_equal(final, [expected.carry["steps"], expected.carry["x"]])
    np.testing.assert_array_equal(kept, [expected.samples["steps"], expected.samples["x"]])


def driver_read(driver: CudaDriver, part: OnDevice) -> np.ndarray:
    out = np.empty(part.shape, part.dtype)
    driver.download(1, out, part.address)
    return out


def test_arrays_that_the_kernel_cannot_read_in_place_are_copied(monkeypatch):
    driver = CudaDriver(FakeCuda(count=2))
    good = OnDevice(driver, 0, np.zeros(5))
    elsewhere, other_type = OnDevice(driver, 1, np.zeros(5)), OnDevice(driver, 0, np.zeros(5, np.float32))
    assert device_arrays.common_device([good, good], 5, np.dtype(float), driver) == 0
    for leaf in (elsewhere, other_type, np.zeros(5), jax.numpy.zeros(5), OnDevice(driver, 0, np.zeros(4))):
        assert device_arrays.common_device([good, leaf], 5, np.dtype(float), driver) is None


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
    ],
)
def test_a_driver_without_a_usable_gpu(device, says):
    assert GpuEngine(lambda: CudaDriver(FakeCuda(**device))).unavailable() == says
