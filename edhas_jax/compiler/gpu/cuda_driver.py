"""The few calls of the CUDA driver that a kernel needs, through ctypes: nothing but the driver has to be installed.

Every call works on one device of the machine, by its number; contexts are the primary ones, so that memory of other
libraries in this process (JAX, CuPy, PyTorch) can be read and written as well.
"""

import ctypes
import functools
import sys
import threading
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

OUT_OF_MEMORY = 2
# numbers of the enumerations in cuda.h
_MULTIPROCESSORS, _CLOCK, _MAJOR, _MINOR = 16, 13, 75, 76
_FUNCTION_LOCAL_BYTES, _FUNCTION_REGISTERS = 3, 4
_JIT_MAX_REGISTERS, _JIT_LOG, _JIT_LOG_BYTES = 0, 5, 6
_POINTER_DEVICE = 9
LOG_BYTES = 4096
UNKNOWN_CLOCK = 1.5e9  # [Hz], where the driver gives none


class CudaError(RuntimeError):
    """The CUDA driver reports an error; the text names the call and gives the driver's words."""


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
    """A function on a device, and what the driver's compiler says of it: registers and bytes in memory per thread."""

    handle: Any
    registers: int
    local_bytes: int


class CudaDriver:
    """The driver behind a `library`, which has the functions of cuda.h.

    Raises:
        CudaError: the driver cannot be initialised.
    """

    def __init__(self, library: Any):
        self._library = library
        self._contexts: dict[int, ctypes.c_void_p] = {}
        self._lock = threading.Lock()
        self._call("cuInit", ctypes.c_uint(0))

    def devices(self) -> list[Device]:
        """The GPUs that this process may use."""
        count = ctypes.c_int()
        self._call("cuDeviceGetCount", ctypes.byref(count))
        return [self._device(number) for number in range(count.value)]

    def kernel(self, device: int, ptx: str, most_registers: int) -> Kernel:
        """Compile the function `run` of a PTX text for a device, with at most so many registers."""
        self._enter(device)
        log = ctypes.create_string_buffer(LOG_BYTES)
        options = (ctypes.c_int * 3)(_JIT_MAX_REGISTERS, _JIT_LOG, _JIT_LOG_BYTES)
        values = (ctypes.c_void_p * 3)(most_registers, ctypes.cast(log, ctypes.c_void_p), LOG_BYTES)
        module, function = ctypes.c_void_p(), ctypes.c_void_p()
        image = ctypes.c_char_p(ptx.encode())
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
        return Kernel(function, *found)

    def allocate(self, device: int, size: int) -> int:
        """The address of new memory on a device.

        Raises:
            OutOfDeviceMemory: there is not as much.
        """
        self._enter(device)
        address = ctypes.c_uint64()
        self._call("cuMemAlloc_v2", ctypes.byref(address), ctypes.c_size_t(max(size, 1)))
        return address.value

    def free(self, device: int, address: int) -> None:
        """Give memory of a device back."""
        self._enter(device)
        self._call("cuMemFree_v2", ctypes.c_uint64(address))

    def upload(self, device: int, address: int, data: np.ndarray) -> None:
        """Copy a contiguous array to a device."""
        self._enter(device)
        source = ctypes.c_void_p(data.ctypes.data)
        self._call("cuMemcpyHtoD_v2", ctypes.c_uint64(address), source, ctypes.c_size_t(data.nbytes))

    def download(self, device: int, data: np.ndarray, address: int) -> None:
        """Copy from a device into a contiguous array."""
        self._enter(device)
        destination = ctypes.c_void_p(data.ctypes.data)
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
        self._enter(device)
        addresses = (ctypes.c_void_p * len(arguments))(*(ctypes.addressof(a) for a in arguments))
        sizes = [ctypes.c_uint(n) for n in (blocks, 1, 1, threads, 1, 1, 0)]
        self._call("cuLaunchKernel", kernel.handle, *sizes, ctypes.c_void_p(None), addresses, ctypes.c_void_p(None))
        self._call("cuCtxSynchronize")

    def device_of(self, address: int) -> int:
        """The number of the device on which an address lies."""
        number = ctypes.c_int()
        self._enter(0)
        self._call("cuPointerGetAttribute", ctypes.byref(number), ctypes.c_int(_POINTER_DEVICE),
                   ctypes.c_uint64(address))  # fmt: skip
        return number.value

    def _device(self, number: int) -> Device:
        handle, name = self._handle(number), ctypes.create_string_buffer(256)
        self._call("cuDeviceGetName", name, ctypes.c_int(len(name)), handle)
        major, minor, multiprocessors, clock = (
            self._attribute(attribute, handle) for attribute in (_MAJOR, _MINOR, _MULTIPROCESSORS, _CLOCK)
        )
        clock = 1e3 * clock or UNKNOWN_CLOCK
        return Device(number, name.value.decode(errors="replace"), (major, minor), multiprocessors, clock)

    def _handle(self, number: int) -> ctypes.c_int:
        handle = ctypes.c_int()
        self._call("cuDeviceGet", ctypes.byref(handle), ctypes.c_int(number))
        return handle

    def _attribute(self, attribute: int, handle: ctypes.c_int) -> int:
        value = ctypes.c_int()
        self._call("cuDeviceGetAttribute", ctypes.byref(value), ctypes.c_int(attribute), handle)
        return value.value

    def _enter(self, device: int) -> None:
        """Make the primary context of a device that of this thread."""
        with self._lock:
            if device not in self._contexts:
                context = ctypes.c_void_p()
                self._call("cuDevicePrimaryCtxRetain", ctypes.byref(context), self._handle(device))
                self._contexts[device] = context
        self._call("cuCtxSetCurrent", self._contexts[device])

    def _call(self, name: str, *arguments: Any) -> None:
        code = getattr(self._library, name)(*arguments)
        if code:
            text = ctypes.c_char_p()
            self._library.cuGetErrorString(ctypes.c_int(code), ctypes.byref(text))
            words = text.value.decode(errors="replace") if text.value else "unknown error"
            kind = OutOfDeviceMemory if code == OUT_OF_MEMORY else CudaError
            raise kind(f"{name}: {words} ({code})")


@functools.cache
def load_driver() -> CudaDriver:
    """The driver of this machine.

    Raises:
        CudaError: it is not installed, or cannot be initialised.
    """
    name = "nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1"
    try:
        library = ctypes.CDLL(name)
    except OSError:
        raise CudaError(f"no NVIDIA driver ({name})") from None
    return CudaDriver(library)
