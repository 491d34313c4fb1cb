"""The few calls of the CUDA driver that a kernel needs, through ctypes: nothing but the driver has to be installed.

Every call works on one device of the machine, by its number. It uses the primary context of the device, which JAX, CuPy
and PyTorch use too, so that their arrays can be read and written; the context that was current before is so again after
the call.
"""

import contextlib
import ctypes
import functools
import sys
import threading
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

LEAST_CUDA = (11, 0)  # the version of CUDA from which on a driver reads PTX ISA 7.0, the version of our kernels
# numbers of the enumerations in cuda.h
OUT_OF_MEMORY = 2
_MULTIPROCESSORS, _CLOCK, _MAJOR, _MINOR = 16, 13, 75, 76
_FUNCTION_LOCAL_BYTES, _FUNCTION_REGISTERS = 3, 4
_JIT_MAX_REGISTERS, _JIT_LOG, _JIT_LOG_BYTES = 0, 5, 6
_POINTER_DEVICE = 9
LOG_BYTES = 4096
UNKNOWN_CLOCK = 1.5e9  # [Hz], where the driver gives none


class CudaError(RuntimeError):
    """The CUDA driver is not there or reports an error; the text names the call and gives the driver's words."""


class OutOfDeviceMemory(CudaError):
    """The memory of a device does not suffice."""


class Device(NamedTuple):
    """A GPU.

    Attributes:
        number: of the device for the driver.
        name: as the driver gives it.
        capability: compute capability.
        multiprocessors: their number.
        clock: of the multiprocessors [Hz].
    """

    number: int
    name: str
    capability: tuple[int, int]
    multiprocessors: int
    clock: float


class Kernel(NamedTuple):
    """A kernel that the driver has compiled for a device.

    Attributes:
        module: of the driver, which holds the kernel.
        handle: of the kernel in it.
        registers: of a thread.
        local_bytes: of memory that a thread uses because its registers do not suffice.
    """

    module: Any
    handle: Any
    registers: int
    local_bytes: int


class CudaDriver:
    """The driver behind a `library`, which has the functions of cuda.h.

    Raises:
        CudaError: the driver cannot be initialised, or is older than CUDA 11.0.
    """

    def __init__(self, library: Any):
        self._library = library
        self._contexts: dict[int, ctypes.c_void_p] = {}
        # reentrant: an array that is collected while a call waits gives its memory back through this driver too
        self._lock = threading.RLock()
        self._call("cuInit", ctypes.c_uint(0))
        number = ctypes.c_int()
        self._call("cuDriverGetVersion", ctypes.byref(number))
        version = number.value // 1000, number.value % 1000 // 10
        if version < LEAST_CUDA:
            older, least = (".".join(map(str, v)) for v in (version, LEAST_CUDA))
            raise CudaError(f"the NVIDIA driver is for CUDA {older}; one for CUDA {least} or later is needed")

    def devices(self) -> list[Device]:
        """The GPUs that this process may use."""
        count = ctypes.c_int()
        self._call("cuDeviceGetCount", ctypes.byref(count))
        return [self._device(number) for number in range(count.value)]

    def kernel(self, device: int, ptx: str, most_registers: int) -> Kernel:
        """Compile the function `run` of a PTX text for a device, with at most so many registers."""
        log = ctypes.create_string_buffer(LOG_BYTES)
        options = (ctypes.c_int * 3)(_JIT_MAX_REGISTERS, _JIT_LOG, _JIT_LOG_BYTES)
        values = (ctypes.c_void_p * 3)(most_registers, ctypes.cast(log, ctypes.c_void_p), LOG_BYTES)
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        image = ctypes.c_char_p(ptx.encode())
        with self._current(device):
            try:
                self._call("cuModuleLoadDataEx", ctypes.byref(module), image, ctypes.c_uint(3), options, values)
            except CudaError as error:
                words = log.value.decode(errors="replace").strip()
                raise type(error)(f"{error}{': ' if words else ''}{words}") from None
            self._call("cuModuleGetFunction", ctypes.byref(function), module, ctypes.c_char_p(b"run"))
            found = []
            for attribute in (_FUNCTION_REGISTERS, _FUNCTION_LOCAL_BYTES):
                value = ctypes.c_int()
                self._call("cuFuncGetAttribute", ctypes.byref(value), ctypes.c_int(attribute), function)
                found.append(value.value)
        return Kernel(module, function, *found)

    def discard(self, device: int, kernel: Kernel) -> None:
        """Give back what a kernel takes on its device."""
        with self._current(device):
            self._call("cuModuleUnload", kernel.module)

    def allocate(self, device: int, size: int) -> int:
        """The address of new memory on a device.

        Raises:
            OutOfDeviceMemory: there is not as much.
        """
        address = ctypes.c_uint64()
        with self._current(device):
            self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(size, 1)))
        return address.value

    def free(self, device: int, address: int) -> None:
        """Give memory of a device back."""
        with self._current(device):
            self._call("cuMemFree_v2", ctypes.c_uint64(address))

    def upload(self, device: int, address: int, data: np.ndarray) -> None:
        """Copy a contiguous array to a device."""
        source = ctypes.c_void_p(data.ctypes.data)
        with self._current(device):
            self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(address), source, ctypes.c_size_t(data.nbytes))

    def download(self, device: int, data: np.ndarray, address: int) -> None:
        """Copy from a device into a contiguous array."""
        destination = ctypes.c_void_p(data.ctypes.data)
        with self._current(device):
            self._call("cuMemcpyDtoH_v2", destination, ctypes.c_uint64(address), ctypes.c_size_t(data.nbytes))

    def launch(self, device: int, kernel: Kernel, blocks: int, threads: int, arguments: Sequence[Any]) -> None:
        """Run a kernel and wait for its end.

        Args:
            device: where it runs.
            kernel: compiled for this device.
            blocks: number of blocks.
            threads: of a block.
            arguments: of the kernel, as types of ctypes in the order and size of its parameters.
        """
        addresses = (ctypes.c_void_p * len(arguments))(*(ctypes.addressof(a) for a in arguments))
        sizes = [ctypes.c_uint(n) for n in (blocks, 1, 1, threads, 1, 1, 0)]
        with self._current(device):
            self._call("cuLaunchKernel", kernel.handle, *sizes, ctypes.c_void_p(None), addresses, ctypes.c_void_p(None))
            self._call("cuCtxSynchronize")

    def device_of(self, address: int) -> int:
        """The number of the device on which an address lies."""
        number = ctypes.c_int()
        with self._current(0):
            self._call("cuPointerGetAttribute", ctypes.byref(number), ctypes.c_int(_POINTER_DEVICE),
                       ctypes.c_uint64(address))  # fmt: skip
        return number.value

    def wait_for_stream(self, device: int, stream: int) -> None:
        """Wait until everything is done that a library has put on one of its streams.

        Args:
            device: of the stream.
            stream: its number, as `__cuda_array_interface__` gives it.
        """
        with self._current(device):
            self._call("cuStreamSynchronize", ctypes.c_void_p(stream))

    def _device(self, number: int) -> Device:
        handle, name = self._handle(number), ctypes.create_string_buffer(256)
        self._call("cuDeviceGetName", name, ctypes.c_int(len(name)), handle)
        major, minor, multiprocessors = (
            self._attribute(attribute, handle) for attribute in (_MAJOR, _MINOR, _MULTIPROCESSORS)
        )
        try:
            clock = 1e3 * self._attribute(_CLOCK, handle)
        except CudaError:  # NVIDIA has announced that this attribute will go
            clock = 0.0
        name = name.value.decode(errors="replace")
        return Device(number, name, (major, minor), multiprocessors, clock or UNKNOWN_CLOCK)

    def _handle(self, number: int) -> ctypes.c_int:
        handle = ctypes.c_int()
        self._call("cuDeviceGet", ctypes.byref(handle), ctypes.c_int(number))
        return handle

    def _attribute(self, attribute: int, handle: ctypes.c_int) -> int:
        value = ctypes.c_int()
        self._call("cuDeviceGetAttribute", ctypes.byref(value), ctypes.c_int(attribute), handle)
        return value.value

    @contextlib.contextmanager
    def _current(self, device: int) -> Iterator[None]:
        """Inside, the primary context of a device is the one of this thread; afterwards the one that was before."""
        with self._lock:
            if device not in self._contexts:
                context = ctypes.c_void_p()
                self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), self._handle(device))
                self._contexts[device] = context
        self._call("cuCtxPushCurrent_v2", self._contexts[device])
        try:
            yield
        finally:
            self._library.cuCtxPopCurrent_v2(ctypes.byref(ctypes.c_void_p()))

    def _call(self, name: str, *arguments: Any) -> None:
        try:
            function = getattr(self._library, name)
        except AttributeError:
            raise CudaError(f"the NVIDIA driver has no function {name}") from None
        code = function(*arguments)
        if code:
            text = ctypes.c_char_p()
            self._library.cuGetErrorString(ctypes.c_int(code), ctypes.byref(text))
            words = text.value.decode(errors="replace") if text.value else "unknown error"
            kind = OutOfDeviceMemory if code == OUT_OF_MEMORY else CudaError
            raise kind(f"GPU: {name}: {words} ({code})")


@functools.cache
def load_driver() -> CudaDriver:
    """The driver of this machine.

    Raises:
        CudaError: it is not installed, cannot be initialised, or is too old.
    """
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        library = ctypes.CDLL(name)
    except OSError:
        raise CudaError(f"no NVIDIA driver ({name})") from None
    return CudaDriver(library)
