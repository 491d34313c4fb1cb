"""Arrays in the memory of a GPU, of JAX or of any other library that has `__cuda_array_interface__`."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver
from edhas_jax.core import runtime


def common_device(leaves: Sequence[Any], count: int, dtype, driver: CudaDriver) -> int | None:
    """The device whose memory holds all leaves as the kernel reads them, (count,) in one piece; None if there is none.

    Arrays of JAX are waited for.
    """
    numbers = set()
    for leaf in leaves:
        interface = _interface(leaf)
        if interface is None or interface["shape"] != (count,) or interface["typestr"] != dtype.str:
            return None
        if interface.get("strides") not in (None, (dtype.itemsize,)):
            return None
        numbers.add(driver.device_of(interface["data"][0]))
    return numbers.pop() if len(numbers) == 1 else None


def row_address(leaf: Any) -> int:
    """The address of an array on a device."""
    return int(_interface(leaf)["data"][0])


def empty_like(leaf: Any, shape: tuple[int, ...], dtype) -> Any:
    """A new array beside `leaf`: of JAX, on the same device, and ready to be written."""
    with runtime.double_precision():
        new = jnp.zeros(shape, dtype, device=leaf.device if isinstance(leaf, jax.Array) else None)
        return jax.block_until_ready(new)


def _interface(leaf: Any) -> dict | None:
    if isinstance(leaf, jax.Array):
        if leaf.is_deleted() or len(leaf.devices()) != 1 or next(iter(leaf.devices())).platform not in ("gpu", "cuda"):
            return None
        jax.block_until_ready(leaf)
    return getattr(leaf, "__cuda_array_interface__", None)
