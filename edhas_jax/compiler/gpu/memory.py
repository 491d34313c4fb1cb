"""Memory of a device that is needed for the time of one calculation."""

from collections.abc import Sequence

import numpy as np

from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, CudaError


class DeviceMemory:
    """Memory of one device; a context manager that gives everything back at its end.

    Raises:
        CudaError: at the end, if the driver does not take memory back and nothing else has failed before. (After an
            error in a kernel the driver refuses every call; the error of the kernel is the one to be told.)
    """

    def __init__(self, driver: CudaDriver, device: int):
        self._driver, self.device = driver, device
        self._addresses: list[int] = []

    def __enter__(self) -> "DeviceMemory":
        return self

    def __exit__(self, kind, error, traceback) -> None:
        failed = error
        while self._addresses:
            try:
                self._driver.free(self.device, self._addresses.pop())
            except CudaError as problem:
                failed = failed or problem
        if error is None and failed is not None:
            raise failed

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
