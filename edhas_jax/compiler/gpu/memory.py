"""Memory of a device for the time of a calculation."""

from collections.abc import Sequence

import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver


class DeviceMemory:
    """Memory of one device; a context manager that gives everything back at its end."""

    def __init__(self, driver: CudaDriver, device: int):
        self._driver, self.device = driver, device
        self._addresses: list[int] = []

    def __enter__(self) -> "DeviceMemory":
        return self

    def __exit__(self, *_) -> None:
        while self._addresses:
            self._driver.free(self.device, self._addresses.pop())

    def new(self, size: int) -> int:
        """The address of `size` bytes.

        Raises:
            OutOfDeviceMemory: the device has not as much left.
        """
        address = self._driver.allocate(self.device, size)
        self._addresses.append(address)
        return address

    def of(self, data: np.ndarray) -> int:
        """The address of a copy of an array."""
        data = np.ascontiguousarray(data)
        address = self.new(data.nbytes)
        self.write(address, data)
        return address

    def table(self, addresses: Sequence[int]) -> int:
        """The address of a table of addresses."""
        return self.of(np.array(addresses, np.uint64))

    def write(self, address: int, data: np.ndarray) -> None:
        """Copy a contiguous array to an address."""
        if data.size:
            self._driver.upload(self.device, address, data)

    def read(self, address: int, shape: tuple[int, ...], dtype) -> np.ndarray:
        """A copy of the array at an address."""
        data = np.empty(shape, dtype)
        if data.size:
            self._driver.download(self.device, data, address)
        return data


def addresses_of_rows(address: int, rows: int, row_bytes: int) -> list[int]:
    """The addresses of the rows of a table."""
    return [address + r * row_bytes for r in range(rows)]
