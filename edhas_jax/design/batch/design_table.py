"""Tables of designs: which value (SI) each parameter takes in each design."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np

from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import ParameterError, find_parameter, format_span, list_parameters, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import METRICS

MOST = 10_000_000  # designs in one sweep


class DesignError(ValueError):
    """A table of designs cannot be made."""


@dataclasses.dataclass(frozen=True)
class Axis:
    """A parameter and the values (SI) it takes: those of a list, or `count` of them from `low` to `high`.

    Samples need no count. With `log`, equal steps are equal ratios.
    """

    name: str
    low: float = 0.0
    high: float = 0.0
    count: int = 0
    values: tuple[float, ...] = ()
    log: bool = False

    def __post_init__(self):
        if self.values:
            twice = next((v for i, v in enumerate(self.values) if v in self.values[:i]), None)
            if twice is not None:
                raise DesignError(f"{self.name}: {twice:g} is listed twice")
        elif not self.low < self.high:
            raise DesignError(f"{self.name}: the range from {self.low:g} to {self.high:g} is empty")
        elif self.log and self.low <= 0.0:
            raise DesignError(f"{self.name}: logarithmic spacing needs a range above 0")

    def levels(self) -> np.ndarray:
        """The values of this axis in a grid."""
        if self.values:
            return np.array(self.values)
        if self.count < 2:
            raise DesignError(f"{self.name}: a range in a grid needs a count of at least 2; got {self.count}")
        return (np.geomspace if self.log else np.linspace)(self.low, self.high, self.count)

    def at(self, share: np.ndarray) -> np.ndarray:
        """The values at these shares (0 … 1) of the axis."""
        if self.values:
            return np.array(self.values)[np.minimum((share * len(self.values)).astype(int), len(self.values) - 1)]
        if self.log:
            value = np.exp(math.log(self.low) + share * (math.log(self.high) - math.log(self.low)))
        else:
            value = self.low + share * (self.high - self.low)
        return np.clip(value, self.low, self.high)


def grid(axes: list[Axis] | tuple[Axis, ...]) -> dict[str, np.ndarray]:
    """Every combination of the axes' values; the last axis changes fastest.

    Raises:
        DesignError: no axis, a name twice, or more designs than a sweep can have.
    """
    _check(axes, 1)
    levels = [axis.levels() for axis in axes]
    total = math.prod(len(v) for v in levels)
    if total > MOST:
        sizes = " × ".join(str(len(v)) for v in levels)
        raise DesignError(f"the grid has {sizes} = {total:,} designs; at most {MOST:,}")
    mesh = np.meshgrid(*levels, indexing="ij")
    return {axis.name: values.ravel() for axis, values in zip(axes, mesh, strict=True)}


def latin_hypercube(axes: list[Axis] | tuple[Axis, ...], n: int, seed: int = 0) -> dict[str, np.ndarray]:
    """`n` designs of which each axis, cut into `n` equal parts, has one in every part."""
    from scipy.stats import qmc

    _check(axes, n)
    return _spread(axes, qmc.LatinHypercube(len(axes), seed=np.random.default_rng(seed)).random(n))


def sobol(axes: list[Axis] | tuple[Axis, ...], n: int, seed: int = 0) -> dict[str, np.ndarray]:
    """The first `n` designs of a scrambled Sobol sequence; a longer one begins with the same designs."""
    from scipy.stats import qmc

    _check(axes, n)
    # a fixed number of bits, so that the scrambling is the same for every n
    engine = qmc.Sobol(len(axes), scramble=True, bits=30, seed=np.random.default_rng(seed))
    return _spread(axes, engine.random_base2(max(0, math.ceil(math.log2(n))))[:n])


def _spread(axes, shares: np.ndarray) -> dict[str, np.ndarray]:
    return {axis.name: axis.at(shares[:, i]) for i, axis in enumerate(axes)}


def _check(axes, n: int) -> None:
    if not axes:
        raise DesignError("at least one parameter is needed")
    names = [axis.name for axis in axes]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice:
        raise DesignError(f"{twice}: given twice")
    if not 1 <= n <= MOST:
        raise DesignError(f"1 … {MOST:,} designs are possible; got {n:,}")


def own_name(machine: Rig, name: str) -> tuple[Parameter, str]:
    """A parameter that can be varied, and the one name by which every table calls it: flat where that is unique.

    Raises:
        ParameterError: unknown, ambiguous, or no parameter but what a run gives.
    """
    flat = name.rpartition(".")[2]
    if flat in METRICS or flat in SIGNALS and flat not in (p.name for p, _, _ in list_parameters(machine)):
        what = f"a metric ({METRICS[flat][2]})" if flat in METRICS else f"a signal ({SIGNALS[flat].doc})"
        raise ParameterError(f"is {what}, which a run gives; only parameters can be varied")
    if flat == "ramp_time":
        raise ParameterError("has no effect in a sweep: every design is run to its periodic state; leave it out")
    p, path = find_parameter(machine, name)
    return p, short_names(machine)[path, p.name]


def table(path: Path | str, machine: Rig) -> dict[str, np.ndarray]:
    """The designs in a CSV or Parquet file: a column `name [unit]` per parameter, a row per design.

    Raises:
        DesignError: no such file, a column that is no parameter of this machine, a hole, a value outside its span.
    """
    path = Path(path)
    if not path.is_file():
        raise DesignError(f"{path}: no such file")
    if path.suffix not in (".csv", ".parquet"):
        raise DesignError(f"{path}: a file .csv or .parquet is needed")
    try:
        header, rows, line = _csv(path) if path.suffix == ".csv" else _parquet(path)
    except (OSError, csv.Error, UnicodeDecodeError) as error:
        raise DesignError(f"{path}: cannot be read as {path.suffix[1:]} ({str(error).splitlines()[0]})") from None
    if not len(rows):
        raise DesignError(f"{path}: has no rows")
    if len(rows) > MOST:
        raise DesignError(f"{path}: has {len(rows):,} designs; at most {MOST:,}")
    found: dict[str, np.ndarray] = {}
    for i, cell in enumerate(header):
        name, unit = cell.partition("[")[0].strip(), cell.partition("[")[2].rstrip("] ").strip()
        try:
            p, own = own_name(machine, name)
            one = to_si(f"1 {unit}", p.unit, f"{name} [{_example(p)}]")
            zero = to_si(f"0 {unit}", p.unit)
        except (ParameterError, UnitError) as error:
            raise DesignError(f"{path}: column `{cell}`: {error}") from None
        if own in found:
            raise DesignError(f"{path}: column `{cell}`: {own} has a column already")
        values = rows[:, i]
        size = one - zero
        # dividing by a whole number makes 20 µm the float that 20e-6 is
        values = values / round(1 / size) if size < 0.7 and not zero else zero + values * size
        low, high = p.span
        bad = ~((low <= values) & (values <= high))
        if bad.any():
            at = int(np.argmax(bad))
            got = format_quantity(values[at], p.unit)
            raise DesignError(f"{path}{line(at)}: {own} must lie in {format_span(p)} ({p.doc}); got {got}")
        found[own] = values
    return found


def _example(p: Parameter) -> str:
    return format_quantity(p.default, p.unit).partition(" ")[2] or "-"


def _csv(path: Path):
    with path.open(encoding="utf-8-sig", newline="") as file:
        reader = csv.reader(file)
        header = [cell.strip() for cell in next(reader, [])]
        if not any(header):
            raise DesignError(f"{path}: is empty; the first line names the columns, such as `piston_clearance [um]`")
        if len(header) == 1 and ";" in header[0]:
            raise DesignError(f"{path}:1: columns must be separated by commas, not semicolons")
        rows, lines = [], []
        for row in reader:
            if not row:
                continue
            place = f"{path}:{reader.line_num}"
            if len(row) != len(header):
                raise DesignError(f"{place}: {len(row)} values where the header has {len(header)}")
            rows.append([_number(cell, place, name) for cell, name in zip(row, header, strict=True)])
            lines.append(reader.line_num)
    return header, np.array(rows, float).reshape(len(rows), len(header)), lambda at: f":{lines[at]}"


def _number(text: str, place: str, name: str) -> float:
    if not text.strip():
        raise DesignError(f"{place}: column `{name}` has a hole; every design needs a value")
    try:
        value = float(text)
    except ValueError:
        raise DesignError(f'{place}: column `{name}`: "{text.strip()}" is not a number') from None
    if not math.isfinite(value):
        raise DesignError(f"{place}: column `{name}`: {text.strip()} is not a finite number")
    return value


def _parquet(path: Path):
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = pq.read_table(path)
    except (pa.ArrowException, ValueError):
        raise DesignError(f"{path}: is damaged or not a Parquet file") from None
    header, columns = [], []
    for i, field in enumerate(data.schema):
        unit = (field.metadata or {}).get(b"unit", b"").decode()
        header.append(field.name if "[" in field.name or unit in ("", "-") else f"{field.name} [{unit}]")
        if not (pa.types.is_floating(field.type) or pa.types.is_integer(field.type)):
            raise DesignError(f"{path}: column `{field.name}` must hold numbers")
        values = data.column(i).to_numpy().astype(float)
        if not np.isfinite(values).all():
            row = int(np.argmax(~np.isfinite(values))) + 1
            raise DesignError(f"{path}: row {row}: column `{field.name}` has a hole or no finite number")
        columns.append(values)
    rows = np.stack(columns, axis=1) if columns else np.zeros((0, 0))
    return header, rows, lambda at: f": row {at + 1}"
