"""A CUDA driver whose devices are memory of this process, and whose kernels run on the processor.

It has the functions of cuda.h that the package calls, with their arguments as ctypes passes them. Every piece of memory
has guards on both sides; whoever reads or writes elsewhere gets an error.
"""

import ctypes
import threading
from collections.abc import Callable

from edhas_jax.compiler.gpu import device_kernel
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver
from edhas_jax.compiler.gpu.engine import GpuEngine
from edhas_jax.compiler.gpu.kernel import ARGUMENTS
from tests.support.gpu_on_host import host_kernel

GUARD = b"guard..." * 8
OUT_OF_MEMORY, ILLEGAL_ADDRESS, INVALID_IMAGE = 2, 700, 200
WORDS = {OUT_OF_MEMORY: b"out of memory", ILLEGAL_ADDRESS: b"illegal address", INVALID_IMAGE: b"invalid image"}
MULTIPROCESSORS, CLOCK, MAJOR, MINOR = 16, 13, 75, 76


class FakeCuda:
    """The library of a driver.

    Args:
        count: of devices.
        memory: of a device [bytes]; None: no limit.
        local_bytes: bytes in memory of a thread, by the most registers it may have.
        capability: compute capability of the devices.
        multiprocessors: of a device.
        error: relative error of every approximate instruction.
    """

    def __init__(
        self, count: int = 1, memory: int | None = None, local_bytes: Callable[[int], int] = lambda registers: 0,
        capability: tuple[int, int] = (9, 0), multiprocessors: int = 4, error: float = 0.0,
    ):  # fmt: skip
        self.count, self.memory, self.local_bytes, self.error = count, memory, local_bytes, error
        self.attributes = {MAJOR: capability[0], MINOR: capability[1], MULTIPROCESSORS: multiprocessors, CLOCK: 1980000}
        self.texts: dict[str, str] = {}  # kernel by its PTX
        self.kernels: list[tuple[Callable, int]] = []  # what runs, and the most registers
        self.launches: list[tuple[int, int, int, int]] = []  # device, blocks, threads, lanes
        self.blocks: dict[int, tuple[int, object, int]] = {}  # address: device, memory, size
        self.used = dict.fromkeys(range(count), 0)
        self.most_used = 0
        self._current, self._lock = threading.local(), threading.Lock()

    # what a kernel was compiled from -------------------------------------------------------------------------------

    def remember(self, write_ptx: Callable) -> Callable:
        """`ptx.ptx`, with the text of every kernel kept."""

        def ptx(kernel: str, name: str, cache=None) -> str:
            text = write_ptx(kernel, name, cache)
            self.texts[text] = kernel
            return text

        return ptx

    # functions of cuda.h -------------------------------------------------------------------------------------------

    def cuInit(self, flags):  # noqa: N802
        return 0

    def cuGetErrorString(self, code, text):  # noqa: N802
        text._obj.value = WORDS.get(code.value, b"some error")
        return 0

    def cuDeviceGetCount(self, count):  # noqa: N802
        count._obj.value = self.count
        return 0

    def cuDeviceGet(self, device, number):  # noqa: N802
        device._obj.value = number.value
        return 0

    def cuDeviceGetName(self, name, size, device):  # noqa: N802
        name.value = b"Fake GPU"
        return 0

    def cuDeviceGetAttribute(self, value, attribute, device):  # noqa: N802
        value._obj.value = self.attributes[attribute.value]
        return 0

    def cuDevicePrimaryCtxRetain(self, context, device):  # noqa: N802
        context._obj.value = 1 + device.value
        return 0

    def cuCtxSetCurrent(self, context):  # noqa: N802
        self._current.device = context.value - 1
        return 0

    def cuCtxSynchronize(self):  # noqa: N802
        return 0

    def cuModuleLoadDataEx(self, module, image, count, options, values):  # noqa: N802
        text = image.value.decode()
        if text not in self.texts:
            ctypes.memmove(values[1], b"ptxas: syntax error\0", 20)
            return INVALID_IMAGE
        self.kernels.append((host_kernel(self.texts[text], self.error), values[0]))
        module._obj.value = len(self.kernels)
        return 0

    def cuModuleGetFunction(self, function, module, name):  # noqa: N802
        function._obj.value = module.value
        return 0 if name.value == b"run" else 500

    def cuFuncGetAttribute(self, value, attribute, function):  # noqa: N802
        most = self.kernels[function.value - 1][1]
        value._obj.value = {4: most, 3: self.local_bytes(most)}[attribute.value]
        return 0

    def cuMemAlloc_v2(self, address, size):  # noqa: N802
        device = self._current.device
        with self._lock:
            if self.memory is not None and self.used[device] + size.value > self.memory:
                return OUT_OF_MEMORY
            block = ctypes.create_string_buffer(size.value + 2 * len(GUARD))
            block[: len(GUARD)], block[-len(GUARD) :] = GUARD, GUARD
            address._obj.value = ctypes.addressof(block) + len(GUARD)
            self.blocks[address._obj.value] = device, block, size.value
            self.used[device] += size.value
            self.most_used = max(self.most_used, self.used[device])
        return 0

    def cuMemFree_v2(self, address):  # noqa: N802
        with self._lock:
            device, block, size = self.blocks.pop(address.value)
            self.used[device] -= size
        # a kernel that writes beside its memory damages a guard
        return 0 if block[: len(GUARD)] == GUARD == block[-len(GUARD) :] else ILLEGAL_ADDRESS

    def cuMemcpyHtoD_v2(self, target, source, size):  # noqa: N802
        return self._copy(target.value, source.value, target.value, size.value)

    def cuMemcpyDtoH_v2(self, target, source, size):  # noqa: N802
        return self._copy(target.value, source.value, source.value, size.value)

    def cuPointerGetAttribute(self, value, attribute, address):  # noqa: N802
        place = self._place(address.value, 1)
        value._obj.value = -1 if place is None else place
        return 0 if place is not None else 1

    def cuLaunchKernel(self, function, *given):  # noqa: N802
        *sizes, stream, parameters, extra = given
        blocks, _, _, threads, _, _, _ = (size.value for size in sizes)
        constants, *rest = parameters
        numbers = [ctypes.c_int64.from_address(address).value for address in rest]
        lanes = numbers[list(ARGUMENTS).index("lanes")]
        with self._lock:
            self.launches.append((self._current.device, blocks, threads, lanes))
            self.kernels[function.value - 1][0](constants, *numbers, blocks, threads)
        return 0

    def _copy(self, target: int, source: int, on_device: int, size: int) -> int:
        if self._place(on_device, size) != self._current.device:
            return ILLEGAL_ADDRESS
        ctypes.memmove(target, source, size)
        return 0

    def _place(self, address: int, size: int) -> int | None:
        """The device in whose memory some bytes lie."""
        with self._lock:
            for start, (device, _, length) in self.blocks.items():
                if start <= address and address + size <= start + length:
                    return device
        return None


def fake_engine(monkeypatch, cuda: FakeCuda) -> GpuEngine:
    """The GPU engine with this driver; it is that of the package during the test."""
    from edhas_jax.compiler import engines

    engine = GpuEngine(lambda: CudaDriver(cuda))
    monkeypatch.setattr(device_kernel, "ptx", cuda.remember(device_kernel.ptx))
    monkeypatch.setattr(engines, "GPU", engine)
    monkeypatch.setattr(engines, "ENGINES", (engine, *(e for e in engines.ENGINES if e.name != engine.name)))
    return engine
