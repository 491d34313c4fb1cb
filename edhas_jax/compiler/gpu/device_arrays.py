"""Arrays in the memory of a GPU, of JAX or of any other library that has `__cuda_array_interface__`.

This interface is described in the documentation of Numba, "CUDA Array Interface (Version 3)".
"""

import math
import weakref
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, CudaError
from edhas_jax.core import runtime


class DeviceArray:
    """A new array in the memory of a device, for the results where the arguments are not of JAX.

    CuPy, PyTorch and Numba take it without a copy, for example by `cupy.asarray(array)`. The memory is given back once
    nobody holds the array or one of its rows. What it contains at first is not defined.

    Attributes:
        shape: of the array.
        dtype: of its numbers.

    Raises:
        OutOfDeviceMemory: the device has not as much left.
    """

    def __init__(self, driver: CudaDriver, device: int, shape: tuple[int, ...], dtype):
        self.shape, self.dtype = tuple(shape), np.dtype(dtype)
        self._whole = None  # of a row, the array that it is part of: it keeps the memory
        self._address = driver.allocate(device, math.prod(self.shape) * self.dtype.itemsize)
        weakref.finalize(self, _free, driver, device, self._address).atexit = False

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        """Where the array lies; the kernel that wrote it has ended, so that there is no stream to wait for."""
        place = self._address, False
        return {"shape": self.shape, "typestr": self.dtype.str, "data": place, "version": 3, "stream": None}

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator["DeviceArray"]:
        """The rows, which lie in the memory of the whole."""
        for k in range(len(self)):
            row = object.__new__(DeviceArray)
            row.shape, row.dtype, row._whole = self.shape[1:], self.dtype, self._whole or self
            row._address = self._address + k * math.prod(row.shape) * self.dtype.itemsize
            yield row


def common_device(leaves: Sequence[Any], count: int, dtype, driver: CudaDriver) -> int | None:
    """The device whose memory holds all leaves as the kernel reads them, (count,) in one piece; None if there is none.

    What is still being computed on a leaf is waited for.
    """
    numbers, streams = set(), set()
    for leaf in leaves:
        interface = _interface(leaf)
        if interface is None or interface["shape"] != (count,) or interface["typestr"] != dtype.str:
            return None
        if interface.get("strides") not in (None, (dtype.itemsize,)):
            return None
        numbers.add(driver.device_of(interface["data"][0]))
        streams.add(interface.get("stream"))
    if len(numbers) != 1:
        return None
    (number,) = numbers
    for stream in streams - {None}:
        driver.wait_for_stream(number, stream)
    return number


def row_address(leaf: Any) -> int:
    """The address of an array on a device."""
    return int(_interface(leaf)["data"][0])


def new_array(beside: Any, shape: tuple[int, ...], dtype, driver: CudaDriver, device: int) -> Any:
    """A new array that may be written, on the device of `beside`: of JAX if this is one, else a `DeviceArray`."""
    if not isinstance(beside, jax.Array):
        return DeviceArray(driver, device, shape, dtype)
    with runtime.double_precision():
        return jax.block_until_ready(jnp.zeros(shape, dtype, device=beside.device))


def _interface(leaf: Any) -> dict | None:
    if isinstance(leaf, jax.Array):
        if leaf.is_deleted() or len(leaf.devices()) != 1 or next(iter(leaf.devices())).platform not in ("gpu", "cuda"):
            return None
        jax.block_until_ready(leaf)
    return getattr(leaf, "__cuda_array_interface__", None)


def _free(driver: CudaDriver, device: int, address: int) -> None:
    try:
        driver.free(device, address)
    except CudaError:  # an error of a kernel, which was told when it happened, has made the driver useless
        return
