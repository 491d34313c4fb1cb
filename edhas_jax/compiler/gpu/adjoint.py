"""Reverse mode on GPUs: segments of the steps are run again from checkpoints, then differentiated from end to start."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from edhas_jax.compiler.backward_body import backward_body
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, Device
from edhas_jax.compiler.gpu.device_kernel import DeviceKernel, March, SampleInputs
from edhas_jax.compiler.gpu.loop import GpuLoop, on_devices
from edhas_jax.compiler.gpu.memory import DeviceMemory, addresses_of_rows
from edhas_jax.compiler.loop_engine import AdjointLoop, LoopBody, lane_count

# run again at a time; checkpoints and segment together take the least memory where it is the square root of all steps
SEGMENT_STEPS = 64


class GpuCheckpoints(NamedTuple):
    """The carry before every segment of steps, (rows, segments, lanes), and the number of steps."""

    carries: np.ndarray
    steps: int


class GpuAdjointLoop(AdjointLoop):
    """`AdjointLoop` with one kernel for the steps and one for their derivative.

    Raises:
        Untranslatable: the body, or its derivative, uses an operation that has no counterpart in the scalar IR.
    """

    def __init__(self, body: LoopBody, driver: CudaDriver, devices: Sequence[Device]):
        self._driver, self._devices = driver, tuple(devices)
        self._ahead = GpuLoop(body, driver, devices)
        self._back = DeviceKernel(backward_body(body), driver, backwards=True)
        self.kernels = (self._ahead.kernel, self._back)

    def run(self, carry: Any, lane: Any, uniform: Any, steps: int, threads: int = 1) -> tuple[Any, GpuCheckpoints]:
        """See `AdjointLoop.run`."""
        whole, rest = divmod(steps, SEGMENT_STEPS)
        parts = []
        for first, per_sample, samples in ((0, SEGMENT_STEPS, whole), (whole * SEGMENT_STEPS, rest, min(rest, 1))):
            if samples:
                carry, kept = self._ahead.run(carry, lane, uniform, first, per_sample, samples)
                parts.append(np.stack(jax.tree.leaves(kept)))
        return carry, GpuCheckpoints(np.concatenate(parts, axis=1), steps)

    def vjp(
        self, checkpoints: GpuCheckpoints, cotangents: Sequence[Any], lane: Any, uniform: Any, threads: int = 1
    ) -> list[tuple[Any, Any]]:
        """See `AdjointLoop.vjp`."""
        body, ahead, back, dtype = self._ahead.body, self._ahead.kernel, self._back, self._back.dtype
        count, rows, size = lane_count(cotangents[0]), ahead.rows["carry"], dtype.itemsize
        fixed = np.array([np.broadcast_to(leaf, count) for leaf in body.leaves("lane", lane)], dtype)
        fixed = fixed.reshape(-1, count)
        starts = [np.stack([np.asarray(w, dtype) for w in body.leaves("carry", tree)]) for tree in cotangents]
        out = [np.empty((rows + len(fixed), count), dtype) for _ in cotangents]
        forth_constants, back_constants = ahead.constants(uniform), back.constants(uniform)

        def work(device: Device, part: range) -> None:
            here, lanes = slice(part.start, part.stop), len(part)
            with DeviceMemory(self._driver, device.number) as memory:
                lane_rows = addresses_of_rows(memory.of(fixed[:, here]), len(fixed), lanes * size)
                state, scratch = (memory.new(rows * lanes * size) for _ in range(2))
                before = memory.new(rows * SEGMENT_STEPS * lanes * size)
                ahead_table = memory.table([*addresses_of_rows(state, rows, lanes * size), *lane_rows])
                # each cotangent has two tables: one is read while the other one is written, and then they change places
                tables = []
                for start in starts:
                    whole = np.concatenate([start[:, here], np.zeros((len(fixed), lanes), dtype)])
                    pair = memory.of(whole), memory.new(whole.nbytes)
                    heads = [(address, addresses_of_rows(address, len(whole), lanes * size)) for address in pair]
                    tables.append([(address, memory.table([*head, *lane_rows])) for address, head in heads])
                for k in reversed(range(checkpoints.carries.shape[1])):
                    first = k * SEGMENT_STEPS
                    march = March(first, 1, min(SEGMENT_STEPS, checkpoints.steps - first))
                    memory.write(state, np.ascontiguousarray(checkpoints.carries[:rows, k, here]))
                    ahead.launch(device, ahead_table, lanes, forth_constants, march, scratch, before)
                    inputs = SampleInputs(before, march.samples * lanes, lanes, 1)
                    for pair in tables:
                        (_, table), (target, _) = pair
                        back.launch(device, table, lanes, back_constants, march, target, inputs=inputs)
                        pair.reverse()
                for whole, ((address, _), _) in zip(out, tables, strict=True):
                    whole[:, here] = memory.read(address, (len(whole), lanes), dtype)

        on_devices(work, self._devices, count)
        structure = jax.tree.structure((body.carry, body.lane))
        return [jax.tree.unflatten(structure, list(table)) for table in out]
