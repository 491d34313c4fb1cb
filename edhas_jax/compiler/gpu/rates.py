"""Whether a GPU is faster than the processor: an estimate from what both are built of, not a measurement.

A processor does one operation per cycle for each number in a vector in this kind of code (measured: docs/speed.md). A
GPU can start a certain number of operations per cycle; the share of this number that is assumed here is the one that a
published solver of the same kind reaches (docs/gpu.md). With few lanes every instruction waits for the one before it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import Device

ISSUE_SHARE = 0.17  # of the operations that a GPU can start
CYCLES_PER_INSTRUCTION = 5.0  # of one thread alone, whose instructions wait for each other
PROCESSOR_CLOCK = 3.0e9  # [Hz], assumed
MARGIN = 2.0  # by which the estimate for the GPU has to exceed that for the processor
# operations per cycle of a multiprocessor in float32 and float64, by compute capability (CUDA C++ Programming Guide,
# table of arithmetic throughput)
_OPERATIONS = {
    (7, 0): (64, 32), (7, 2): (64, 32), (7, 5): (64, 2), (8, 0): (64, 32), (8, 6): (128, 2), (8, 7): (128, 2),
    (8, 9): (128, 2), (9, 0): (128, 64), (10, 0): (128, 64), (10, 3): (128, 2), (12, 0): (128, 2), (12, 1): (128, 2),
}  # fmt: skip
_UNKNOWN = 128, 2


class Rates(NamedTuple):
    """Operations per second.

    Attributes:
        full: of the GPUs, with as many lanes as they can take.
        one_lane: of a single lane on a GPU.
        processor: of the processor.
    """

    full: float
    one_lane: float
    processor: float

    def least_lanes(self) -> int | None:
        """The number of lanes from which on the GPUs are faster; None if they never are."""
        wanted = MARGIN * self.processor
        return None if wanted > self.full else max(int(np.ceil(wanted / self.one_lane)), 1)


def estimated_rates(devices: Sequence[Device], cores: int, vector_bytes: int, dtype) -> Rates:
    """The estimate for a precision.

    Args:
        devices: the GPUs.
        cores: of the processor.
        vector_bytes: size of its vectors.
        dtype: floating-point type.
    """
    single = np.dtype(dtype).itemsize == 4
    full = sum(d.multiprocessors * issue_rate(d, single) * d.clock * ISSUE_SHARE for d in devices)
    one_lane = devices[0].clock / CYCLES_PER_INSTRUCTION
    return Rates(full, one_lane, cores * vector_bytes / np.dtype(dtype).itemsize * PROCESSOR_CLOCK)


def issue_rate(device: Device, single: bool) -> int:
    """Operations per cycle of a multiprocessor, in float32 or else float64."""
    return _OPERATIONS.get(device.capability, _UNKNOWN)[0 if single else 1]
