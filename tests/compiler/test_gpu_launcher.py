"""The launcher end to end, on a driver whose devices are memory of this process."""

import ctypes
import functools
from concurrent.futures import ThreadPoolExecutor

import jax
import numpy as np
import pytest

from edhas_jax.compiler.gpu import device_arrays
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, CudaError, Device, OutOfDeviceMemory
from edhas_jax.compiler.gpu.device_kernel import BLOCK_THREADS, launch_size
from edhas_jax.compiler.gpu.loop import deal
from edhas_jax.compiler.gpu.memory import DeviceMemory
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.native_loop import NativeLoop
from edhas_jax.compiler.xla_engine import XlaLoop
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
    assert [most for _, most in cuda.kernels] == [128, 168, 255] and cuda.loaded == {3}


@pytest.mark.parametrize(("lanes", "steps", "samples"), [(0, 1, 1), (3, 0, 1), (3, 1, 0)])
def test_a_run_of_nothing_is_refused_by_every_engine(lanes, steps, samples, made):
    for loop in (made(decay_body(float))[0], NativeLoop(decay_body(float)), XlaLoop(decay_body(float))):
        with pytest.raises(ValueError, match="at least one lane, one step and one sample"):
            loop.run(*decay_lanes(lanes), 0, steps, samples)


def test_arrays_with_gaps_in_other_types_and_of_jax(made):
    loop, _ = made(decay_body(float))
    carry, lane, uniform = decay_lanes(40)
    expected = loop(carry, lane, uniform, 0, 9)
    wide = np.repeat(lane["rate"], 3)
    for rate in (wide[::3], wide[::-3][::-1], lane["rate"].astype(">f8"), jax.numpy.asarray(lane["rate"])):
        jax.tree.map(np.testing.assert_array_equal, loop(carry, {"rate": rate}, uniform, 0, 9), expected)
    gone = jax.numpy.asarray(lane["rate"])
    gone.delete()  # as an argument that was donated is
    with pytest.raises(RuntimeError, match="deleted"):
        loop(carry, {"rate": gone}, uniform, 0, 9)


def test_the_context_of_another_library_stays_current(made):
    """As where JAX or PyTorch has made a context for this thread before."""
    loop, cuda = made(decay_body(float), count=3)
    cuda.contexts.append(2)
    loop(*decay_lanes(1003), 0, 4)
    assert cuda.contexts == [2]
    with pytest.raises(ValueError):
        loop(*decay_lanes(0), 0, 4)
    assert cuda.contexts == [2]


def test_several_threads_of_python_use_one_loop(made):
    loop, cuda = made(decay_body(float), count=2)
    expected = [NativeLoop(decay_body(float))(*decay_lanes(count), 0, 20) for count in range(200, 232)]
    with ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda count: loop(*decay_lanes(count), 0, 20), range(200, 232)))
    jax.tree.map(np.testing.assert_array_equal, found, expected)
    assert not cuda.blocks and len(cuda.loaded) == 2


def test_the_error_of_a_kernel_is_told_and_not_those_that_follow(made):
    loop, cuda = made(decay_body(float), breaks=True)
    with pytest.raises(CudaError, match=r"cuCtxSynchronize: illegal address \(700\)"):
        loop(*decay_lanes(100), 0, 4)
    assert cuda.contexts == []


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
    """An array in the memory of a fake device, of a library that has put work on a stream."""

    def __init__(self, driver: CudaDriver, device: int, data: np.ndarray, stream: int | None = None):
        self.address, self.stream = driver.allocate(device, data.nbytes), stream
        driver.upload(device, self.address, np.ascontiguousarray(data))
        self.shape, self.dtype, self.ndim = data.shape, data.dtype, data.ndim

    @property
    def __cuda_array_interface__(self):
        return {"shape": self.shape, "typestr": self.dtype.str, "data": (self.address, False), "version": 3,
                "stream": self.stream}  # fmt: skip


@pytest.mark.parametrize("keep", [True, False])
def test_arrays_on_a_device_are_read_and_written_where_they_are(keep, monkeypatch):
    """Nothing of them is copied to the host or back: only the tables of addresses go to the device."""
    cuda = FakeCuda(count=2)
    engine = fake_engine(monkeypatch, cuda)
    loop, driver = engine.compile(decay_body(float)), engine._load()
    carry, lane, uniform = decay_lanes(100)
    expected = loop.run(carry, lane, uniform, 0, 2, 6)
    given = jax.tree.map(lambda leaf: OnDevice(driver, 1, leaf, stream=7), (carry, lane))
    before, copied, write = dict(cuda.used), [], cuda.cuMemcpyHtoD_v2
    with monkeypatch.context() as patch:
        patch.setattr(cuda, "cuMemcpyHtoD_v2", lambda *a: copied.append(a[2].value) or write(*a))
        patch.setattr(cuda, "cuMemcpyDtoH_v2", None)
        found = loop.run(*given, uniform, 0, 2, 6, keep=keep)
    assert sum(copied) <= 8 * len(jax.tree.leaves(given)) and cuda.launches[-1][0] == 1
    assert cuda.streams == [(1, 7)]
    final, *kept = (jax.tree.map(functools.partial(driver_read, driver), part) for part in found if part is not None)
    jax.tree.map(np.testing.assert_array_equal, final, expected.carry)
    if keep:
        jax.tree.map(np.testing.assert_array_equal, kept[0], expected.samples)
    # a row keeps the memory of the whole, and gives it back with the last one
    row = found.carry["x"]
    del found
    assert cuda.used[1] > before[1] and driver_read(driver, row)[0] == expected.carry["x"][0]
    del row
    assert cuda.used == before


def driver_read(driver: CudaDriver, array) -> np.ndarray:
    interface = array.__cuda_array_interface__
    out = np.empty(interface["shape"], interface["typestr"])
    driver.download(1, out, interface["data"][0])
    return out


def test_arrays_on_a_device_that_is_too_old_for_kernels_do_not_crash(monkeypatch):
    """Such arrays are treated as arrays that are not on a device that serves."""
    engine = fake_engine(monkeypatch, FakeCuda(count=2))
    loop, driver = engine.compile(decay_body(float)), engine._load()
    loop._devices = loop._devices[:1]
    carry, lane, uniform = decay_lanes(40)
    on_device = jax.tree.map(lambda leaf: OnDevice(driver, 1, leaf), (carry, lane))
    with pytest.raises((TypeError, ValueError)):  # NumPy cannot read such an array
        loop.run(*on_device, uniform, 0, 2, 6)


def test_arrays_that_the_kernel_cannot_read_in_place_are_copied(monkeypatch):
    driver = CudaDriver(FakeCuda(count=2))
    good = OnDevice(driver, 0, np.zeros(5))
    elsewhere, other_type = OnDevice(driver, 1, np.zeros(5)), OnDevice(driver, 0, np.zeros(5, np.float32))
    assert device_arrays.common_device([good, good], 5, np.dtype(float), driver) == 0
    for leaf in (elsewhere, other_type, np.zeros(5), jax.numpy.zeros(5), OnDevice(driver, 0, np.zeros(4))):
        assert device_arrays.common_device([good, leaf], 5, np.dtype(float), driver) is None
