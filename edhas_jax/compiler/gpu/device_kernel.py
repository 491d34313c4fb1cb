"""The kernel of a loop body, compiled for the devices of this machine, and its launch."""

import ctypes
import threading
from typing import Any, NamedTuple

import numpy as np

from edhas_jax.compiler.body_program import body_program
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, Device, Kernel
from edhas_jax.compiler.gpu.kernel import ARGUMENTS, kernel_text
from edhas_jax.compiler.gpu.ptx import ptx, target
from edhas_jax.compiler.llvm_jit import function, host
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.core import runtime

# registers of a thread, tried in turn: with 128, 168 and 255 a multiprocessor holds 512, 384 and 256 threads
REGISTERS = (128, 168, 255)
MOST_SPILLED_BYTES = 64  # of a thread, for which fewer registers are taken
BLOCK_THREADS = (128, 64, 32)
WARP = 32  # threads that a GPU runs together
MOST_STEPS = 2**31 - 1


class March(NamedTuple):
    """The steps of one launch; the fields are arguments of `Loop.run`."""

    first: int
    steps_per_sample: int
    samples: int


class SampleInputs(NamedTuple):
    """Where the sample inputs lie on the device, with the distances between rows, samples and lanes in numbers."""

    address: int = 0
    row_stride: int = 0
    sample_stride: int = 0
    lane_stride: int = 0


class DeviceKernel:
    """A loop body compiled for the devices of a driver.

    Raises:
        Untranslatable: the body uses an operation that has no counterpart, or its constants are too many.
    """

    def __init__(self, body: LoopBody, driver: CudaDriver, backwards: bool = False):
        self.body, self.driver, self.dtype = body, driver, np.dtype(body.dtype)
        program, sources, self.rows = body_program(body)
        self.text = kernel_text(program, host().processor, sources, self.rows["carry"], backwards)
        arguments = [ctypes.c_void_p] * 2
        self._constants = function(lambda: self.text.constants, "constants", arguments, runtime.cache_folder())
        self._kernels: dict[int, Kernel] = {}
        self._lock = threading.Lock()

    def on(self, device: Device) -> Kernel:
        """The kernel on a device, compiled at its first use with as few registers as it does with.

        Raises:
            CudaError: the driver cannot compile it.
        """
        with self._lock:
            if device.number not in self._kernels:
                text = ptx(self.text.kernel, target(device.capability), runtime.cache_folder())
                for registers in REGISTERS:
                    kernel = self.driver.kernel(device.number, text, registers)
                    if kernel.local_bytes <= MOST_SPILLED_BYTES or registers == REGISTERS[-1]:
                        break
                    self.driver.discard(device.number, kernel)
                self._kernels[device.number] = kernel
            return self._kernels[device.number]

    def constants(self, uniform: Any) -> np.ndarray:
        """The first argument of the kernel, computed from `uniform`, the values that all lanes share."""
        given = np.array([*self.body.leaves("uniform", uniform)], self.dtype)
        found = np.zeros(max(self.text.count, 1), self.dtype)
        self._constants(given.ctypes.data, found.ctypes.data)
        return found

    def launch(
        self, device: Device, rows: int, lanes: int, constants: np.ndarray, march: March, final: int, kept: int = 0,
        inputs: SampleInputs = SampleInputs(),
    ) -> None:  # fmt: skip
        """Run the steps `march` of `lanes` lanes and wait until the kernel has ended.

        Args:
            device: where the memory is.
            rows: address of a table with the addresses of the rows of the carry and of the lane values.
            lanes: number of lanes.
            constants: as `constants` makes them.
            march: steps and samples.
            final: address of the final carry, (rows, lanes).
            kept: address of the carries at the samples, (rows, samples, lanes), or 0.
            inputs: sample inputs.

        Raises:
            ValueError: steps with numbers beyond 2³¹.
        """
        if march.first + march.steps_per_sample * march.samples > MOST_STEPS:
            raise ValueError(f"a step of a GPU loop has a number up to {MOST_STEPS:,}")
        values = {
            "rows": rows, "inputs": inputs.address, "final": final, "kept": kept,
            "first": march.first, "steps_per_sample": march.steps_per_sample, "samples": march.samples, "lanes": lanes,
            "input_row_stride": inputs.row_stride, "input_sample_stride": inputs.sample_stride,
            "input_lane_stride": inputs.lane_stride,
        }  # fmt: skip
        block = (ctypes.c_char * constants.nbytes).from_buffer_copy(constants)
        # addresses and numbers of steps are below 2⁶³
        arguments = [block, *(ctypes.c_int64(values[name]) for name in ARGUMENTS)]
        self.driver.launch(device.number, self.on(device), *launch_size(lanes, device.multiprocessors), arguments)


def launch_size(lanes: int, multiprocessors: int) -> tuple[int, int]:
    """The number of blocks and of threads of each; where large blocks would leave multiprocessors idle, small ones."""
    for threads in BLOCK_THREADS:
        blocks = -(-lanes // threads)
        if blocks >= multiprocessors:
            break
    return blocks, threads
