"""Designs of experiments: axes of parameters, full factorial grids, Latin hypercube and Sobol samples."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from edhas_jax.core.units import format_quantity

MAX_DESIGNS = 10_000_000  # of one sweep


class DesignError(ValueError):
    """A table of designs cannot be generated or read."""


def first_repeated(values: Sequence[float]) -> float | None:
    """The first value that was there before; None if every one is there once."""
    seen: set[float] = set()
    return next((v for v in values if v in seen or seen.add(v)), None)


@dataclasses.dataclass(frozen=True)
class Axis:
    """A parameter and the values (SI) it takes in a design of experiments: a list, or a range.

    Attributes:
        name: the parameter.
        low: lower end of the range, SI.
        high: upper end of the range, SI.
        count: number of values in a grid; not needed for samples.
        values: list of values, SI; replaces the range.
        log: whether the range is divided in equal ratios.
        unit: SI unit of the values.

    Raises:
        DesignError: a value twice, an empty range, or a logarithmic one that is not positive.
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    count: int = 0
    values: tuple[float, ...] = ()
    log: bool = False
    unit: str = "-"

    def __post_init__(self):
        if self.values:
            if (repeated := first_repeated(self.values)) is not None:
                raise DesignError(f"{self.name}: {format_quantity(repeated, self.unit)} is listed twice")
        elif not self.low < self.high:
            low, high = (format_quantity(end, self.unit) for end in (self.low, self.high))
            raise DesignError(f"{self.name}: the range from {low} to {high} is empty; `from` must lie below `to`")
        elif self.log and self.low <= 0.0:
            raise DesignError(f"{self.name}: logarithmic spacing needs a range above 0")

    def grid_values(self) -> np.ndarray:
        """The values (SI) of this axis in a grid, shape (count,)."""
        if self.values:
            return np.array(self.values)
        if self.count < 2:
            raise DesignError(f"{self.name}: a range in a grid needs a count of at least 2; got {self.count}")
        return (np.geomspace if self.log else np.linspace)(self.low, self.high, self.count)

    def at_fractions(self, fractions: np.ndarray) -> np.ndarray:
        """The values (SI) at fractions 0 … 1 of the axis, of the same shape."""
        if self.values:
            index = np.minimum((fractions * len(self.values)).astype(int), len(self.values) - 1)
            return np.array(self.values)[index]
        if self.log:
            value = np.exp(math.log(self.low) + fractions * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + fractions * (self.high - self.low)
        return np.clip(value, self.low, self.high)

    def fraction_of(self, value: float) -> float:
        """The fraction 0 … 1 of the range at which a value (SI) lies."""
        if self.log:
            return float(np.log(value / self.low) / np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def derivative_at(self, values: np.ndarray) -> np.ndarray:
        """The derivatives of values (SI) of the range by their fraction, of the same shape."""
        return values * np.log(self.high / self.low) if self.log else np.full_like(values, self.high - self.low)


def full_factorial(axes: Sequence[Axis]) -> dict[str, np.ndarray]:
    """Every combination of the values of the axes; the last axis changes fastest.

    Args:
        axes: the parameters with their values.

    Returns:
        By parameter a column of values (SI), shape (designs,).

    Raises:
        DesignError: no axis, a name twice, a range without a count, or more than `MAX_DESIGNS`.
    """
    _check_axes(axes, 1)
    values = [axis.grid_values() for axis in axes]
    total = math.prod(len(v) for v in values)
    if total > MAX_DESIGNS:
        sizes = " × ".join(str(len(v)) for v in values)
        raise DesignError(f"the grid has {sizes} = {total:,} designs; at most {MAX_DESIGNS:,}")
    mesh = np.meshgrid(*values, indexing="ij")
    return {axis.name: column.ravel() for axis, column in zip(axes, mesh, strict=True)}


def latin_hypercube(axes: Sequence[Axis], n: int, seed: int = 0) -> dict[str, np.ndarray]:
    """Latin hypercube sample: each of `n` equal parts of every axis contains exactly one design.

    Args:
        axes: the parameters with their values.
        n: number of designs.
        seed: of the random numbers.

    Returns:
        By parameter a column of values (SI), shape (n,).

    Raises:
        DesignError: no axis, a name twice, or more than `MAX_DESIGNS`.
    """
    from scipy.stats import qmc

    _check_axes(axes, n)
    return designs_at(axes, qmc.LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(n))


def sobol_sequence(axes: Sequence[Axis], n: int, seed: int = 0) -> dict[str, np.ndarray]:
    """The first `n` points of a scrambled Sobol sequence; a longer sequence begins with the same points.

    Args:
        axes: the parameters with their values.
        n: number of designs.
        seed: of the scrambling.

    Returns:
        By parameter a column of values (SI), shape (n,).

    Raises:
        DesignError: no axis, a name twice, or more than `MAX_DESIGNS`.
    """
    from scipy.stats import qmc

    _check_axes(axes, n)
    # a fixed number of bits makes the scrambling independent of n
    engine = qmc.Sobol(len(axes), scramble=True, bits=30, seed=np.random.default_rng(seed))
    return designs_at(axes, engine.random_base2(max(0, math.ceil(math.log2(n))))[:n])


def designs_at(axes: Sequence[Axis], fractions: np.ndarray) -> dict[str, np.ndarray]:
    """The designs at fractions (n, axes) of their axes: by parameter a column of values (SI), shape (n,)."""
    return {axis.name: axis.at_fractions(fractions[:, i]) for i, axis in enumerate(axes)}


def _check_axes(axes: Sequence[Axis], n: int) -> None:
    if not axes:
        raise DesignError("at least one parameter is needed")
    names = [axis.name for axis in axes]
    if repeated := next((name for name in names if names.count(name) > 1), None):
        raise DesignError(f"{repeated}: given twice")
    if not 1 <= n <= MAX_DESIGNS:
        raise DesignError(f"1 … {MAX_DESIGNS:,} designs are possible; got {n:,}")
