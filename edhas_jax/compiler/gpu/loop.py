"""Loops on GPUs: each device gets a part of the lanes, which is halved where its memory does not suffice."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, Device, OutOfDeviceMemory
from edhas_jax.compiler.gpu.device_arrays import common_device, new_array, row_address
from edhas_jax.compiler.gpu.device_kernel import BLOCK_THREADS, WARP, DeviceKernel, March, SampleInputs
from edhas_jax.compiler.gpu.memory import DeviceMemory, addresses_of_rows
from edhas_jax.compiler.loop_engine import Loop, LoopBody, LoopResult, check_size, lane_count
from edhas_jax.compiler.threads import run_threaded


class GpuLoop(Loop):
    """A `LoopBody` as a kernel: one thread per lane, and on each device one launch for all steps.

    The arguments may be NumPy arrays, which are copied to the devices and back. If all of them are arrays of JAX, or
    of another library, in the memory of one GPU, they are read where they lie, and the result lies on that GPU too: in
    arrays of JAX, or else in `DeviceArray`s.
    """

    def __init__(self, body: LoopBody, driver: CudaDriver, devices: Sequence[Device]):
        self.body, self._driver, self._devices = body, driver, tuple(devices)
        self.kernel = DeviceKernel(body, driver)
        self.kernels = (self.kernel,)
        self.lanes = self._devices[0].multiprocessors * BLOCK_THREADS[0]

    def run(
        self, carry: Any, lane: Any, uniform: Any, first: int, steps_per_sample: int, samples: int, threads: int = 1,
        keep: bool = True, sample_inputs: Any = None,
    ) -> LoopResult:  # fmt: skip
        """See `Loop.run`; `threads` has no meaning here."""
        body, dtype, count = self.body, self.kernel.dtype, lane_count(carry)
        check_size(count, steps_per_sample, samples)
        leaves = [*body.leaves("carry", carry), *body.leaves("lane", lane)]
        march, constants = March(first, steps_per_sample, samples), self.kernel.constants(uniform)
        columns = np.empty((0, samples), dtype)
        if sample_inputs is not None:
            columns = np.stack([np.asarray(leaf, dtype) for leaf in body.leaves("sample_inputs", sample_inputs)])
        number = common_device(leaves, count, dtype, self._driver)
        device = next((d for d in self._devices if d.number == number), None)
        if device is not None:
            final, kept = self._on_device(device, leaves, count, march, constants, columns, keep)
        else:
            rows = [np.broadcast_to(np.asarray(leaf, dtype), count) for leaf in leaves]
            final = np.empty((self.kernel.rows["carry"], count), dtype)
            kept = np.empty((len(final), samples, count), dtype) if keep else None

            def work(device: Device, lanes: range) -> None:
                part = slice(lanes.start, lanes.stop)
                here = np.stack([row[part] for row in rows])
                with DeviceMemory(self._driver, device.number) as memory:
                    out = self._marched(device, memory, here, march, constants, columns, keep)
                final[:, part] = out[0]
                if keep:
                    kept[:, :, part] = out[1]

            on_devices(work, self._devices, count)
        structure = jax.tree.structure(body.carry)
        kept = jax.tree.unflatten(structure, list(kept)) if keep else None
        return LoopResult(jax.tree.unflatten(structure, list(final)), kept)

    def _marched(self, device, memory: DeviceMemory, here, march: March, constants, columns, keep: bool):
        """Final carry and kept carries, or None, of some lanes with the values `here`, (rows, lanes)."""
        lanes, size, rows = here.shape[1], here.itemsize, self.kernel.rows["carry"]
        table = memory.table(addresses_of_rows(memory.of(here), len(here), lanes * size))
        final = memory.new(rows * lanes * size)
        kept = memory.new(rows * march.samples * lanes * size) if keep else 0
        inputs = SampleInputs(memory.of(columns), march.samples, 1, 0)
        self.kernel.launch(device, table, lanes, constants, march, final, kept, inputs)
        out = memory.read(final, (rows, lanes), here.dtype)
        return out, memory.read(kept, (rows, march.samples, lanes), here.dtype) if keep else None

    def _on_device(self, device: Device, leaves, count: int, march: March, constants, columns, keep: bool):
        """As `_marched`, for leaves in the memory of a device and results there."""
        rows, dtype = self.kernel.rows["carry"], self.kernel.dtype
        place = self._driver, device.number
        final = new_array(leaves[0], (rows, count), dtype, *place)
        kept = new_array(leaves[0], (rows, march.samples, count), dtype, *place) if keep else None
        with DeviceMemory(self._driver, device.number) as memory:
            inputs = SampleInputs(memory.of(columns), march.samples, 1, 0)
            table = memory.table([row_address(leaf) for leaf in leaves])
            places = row_address(final), row_address(kept) if keep else 0
            self.kernel.launch(device, table, count, constants, march, *places, inputs)
        return final, kept

    def with_vectors(self, vectors: int) -> "GpuLoop":
        """See `Loop.with_vectors`."""
        return self


def on_devices(work: Callable[[Device, range], None], devices: Sequence[Device], count: int) -> None:
    """Call `work` for parts of the lanes: one for each device, or more where its memory does not suffice.

    Devices work at the same time, each called from a thread of this process.

    Raises:
        OutOfDeviceMemory: not even one warp finds room.
    """
    run_threaded(lambda part: _in_halves(work, *part), deal(devices, count), len(devices))


def deal(devices: Sequence[Device], count: int) -> list[tuple[Device, range]]:
    """The lanes of each device: whole warps, in proportion to its multiprocessors; few lanes all go to the first."""
    if count <= devices[0].multiprocessors * WARP:
        return [(devices[0], range(count))]
    weights = np.cumsum([d.multiprocessors for d in devices])
    ends = [int(-(-(count * w) // (weights[-1] * WARP))) * WARP for w in weights]
    starts = [0, *ends[:-1]]
    parts = [range(min(a, count), min(b, count)) for a, b in zip(starts, ends, strict=True)]
    return [(device, part) for device, part in zip(devices, parts, strict=True) if len(part)]


def _in_halves(work: Callable[[Device, range], None], device: Device, lanes: range) -> None:
    """Call `work` for some lanes, or for each half of them, and so on, until the memory of the device suffices."""
    try:
        work(device, lanes)
    except OutOfDeviceMemory:
        if len(lanes) <= WARP:
            raise
    else:
        return
    middle = lanes.start + -(-len(lanes) // (2 * WARP)) * WARP
    for half in (range(lanes.start, middle), range(middle, lanes.stop)):
        _in_halves(work, device, half)
