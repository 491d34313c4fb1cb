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
from edhas_jax.simulation import loop_cache
from tests.support.gpu_on_host import host_kernel

GUARD = b"guard..." * 8
INVALID_VALUE, OUT_OF_MEMORY, NO_CONTEXT, ILLEGAL_ADDRESS, INVALID_IMAGE = 1, 2, 201, 700, 200
WORDS = {INVALID_VALUE: b"invalid argument", OUT_OF_MEMORY: b"out of memory", NO_CONTEXT: b"invalid device context",
         ILLEGAL_ADDRESS: b"illegal address", INVALID_IMAGE: b"invalid image"}  # fmt: skip
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
        cuda: version of CUDA that the driver is for.
        breaks: whether every kernel makes an error, after which a driver refuses all calls.
    """

    def __init__(
        self, count: int = 1, memory: int | None = None, local_bytes: Callable[[int], int] = lambda registers: 0,
        capability: tuple[int, int] = (9, 0), multiprocessors: int = 4, error: float = 0.0,
        cuda: tuple[int, int] = (12, 4), breaks: bool = False,
    ):  # fmt: skip
        self.count, self.memory, self.local_bytes, self.error = count, memory, local_bytes, error
        self.attributes = {MAJOR: capability[0], MINOR: capability[1], MULTIPROCESSORS: multiprocessors, CLOCK: 1980000}
        self.texts: dict[str, str] = {}  # kernel by its PTX
        self.kernels: list[tuple[Callable, int]] = []  # what runs, and the most registers
        self.launches: list[tuple[int, int, int, int]] = []  # device, blocks, threads, lanes
        self.blocks: dict[int, tuple[int, object, int]] = {}  # address: device, memory, size
        self.used = dict.fromkeys(range(count), 0)
        self.most_used = 0
        self.cuda, self.breaks, self.is_broken = cuda, breaks, False
        self.loaded: set[int] = set()  # modules
        self.streams: list[tuple[int, int]] = []  # device and number of each that was waited for
        self._contexts, self._lock = threading.local(), threading.RLock()

    @property
    def contexts(self) -> list[int]:
        """The devices whose contexts are on the stack of this thread; the last is the current one."""
        return self._contexts.__dict__.setdefault("stack", [])

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

    def cuDriverGetVersion(self, version):  # noqa: N802
        version._obj.value = 1000 * self.cuda[0] + 10 * self.cuda[1]
        return 0

    def cuCtxPushCurrent_v2(self, context):  # noqa: N802
        self.contexts.append(context.value - 1)
        return 0

    def cuCtxPopCurrent_v2(self, context):  # noqa: N802
        context._obj.value = 1 + self.contexts.pop()
        return 0

    def cuCtxSynchronize(self):  # noqa: N802
        self.is_broken = self.breaks
        return self._state()

    def cuStreamSynchronize(self, stream):  # noqa: N802
        self.streams.append((self.contexts[-1], stream.value))
        return self._state()

    def _state(self) -> int:
        """The code of a call that needs a context."""
        if not self.contexts:
            return NO_CONTEXT
        return ILLEGAL_ADDRESS if self.is_broken else 0

    def cuModuleLoadDataEx(self, module, image, count, options, values):  # noqa: N802
        text = image.value.decode()
        if text not in self.texts:
            ctypes.memmove(values[1], b"ptxas: syntax error\0", 20)
            return INVALID_IMAGE
        self.kernels.append((host_kernel(self.texts[text], self.error), values[0]))
        module._obj.value = len(self.kernels)
        self.loaded.add(len(self.kernels))
        return self._state()

    def cuModuleUnload(self, module):  # noqa: N802
        self.loaded.remove(module.value)
        return self._state()

    def cuModuleGetFunction(self, function, module, name):  # noqa: N802
        function._obj.value = module.value
        return 0 if name.value == b"run" else 500

    def cuFuncGetAttribute(self, value, attribute, function):  # noqa: N802
        if function.value not in self.loaded:
            return INVALID_VALUE
        most = self.kernels[function.value - 1][1]
        value._obj.value = {4: most, 3: self.local_bytes(most)}[attribute.value]
        return 0

    def cuMemAlloc_v2(self, address, size):  # noqa: N802
        if code := self._state():
            return code
        device = self.contexts[-1]
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
        if code := self._state():
            return code
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
        return 0 if place is not None else INVALID_VALUE

    def cuLaunchKernel(self, function, *given):  # noqa: N802
        *sizes, stream, parameters, extra = given
        blocks, _, _, threads, _, _, _ = (size.value for size in sizes)
        constants, *rest = parameters
        numbers = [ctypes.c_int64.from_address(address).value for address in rest]
        lanes = numbers[list(ARGUMENTS).index("lanes")]
        if not blocks or function.value not in self.loaded:
            return INVALID_VALUE
        if code := self._state():
            return code
        with self._lock:
            self.launches.append((self.contexts[-1], blocks, threads, lanes))
            self.kernels[function.value - 1][0](constants, *numbers, blocks, threads)
        return 0

    def _copy(self, target: int, source: int, on_device: int, size: int) -> int:
        if code := self._state():
            return code
        if self._place(on_device, size) != self.contexts[-1]:
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

    loop_cache._made.cache_clear()  # loops of another fake driver
    engine = GpuEngine(lambda: CudaDriver(cuda))
    monkeypatch.setattr(device_kernel, "ptx", cuda.remember(device_kernel.ptx))
    monkeypatch.setattr(engines, "GPU", engine)
    monkeypatch.setattr(engines, "ENGINES", (engine, *(e for e in engines.ENGINES if e.name != engine.name)))
    return engine
