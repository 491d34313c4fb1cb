"""Tables of numbers that a configuration names: CSV or Parquet files with headers `name [unit]`.

What is wrong in them is refused; a record of a campaign, of which much may be wrong, is read by
`edhas_jax.measurements.tables`.
"""

import array
import csv
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np


class NumberTableError(ValueError):
    """A table cannot be read; the message begins with its path, and the line if there is one."""


class NumberTable:
    """A file with named columns of numbers.

    Args:
        path: the file.

    Attributes:
        headers: of the columns as in the file; of Parquet with the unit that the column states otherwise.
        names: of the columns, without unit.
        units: of the columns as in the file; "" without one.

    Raises:
        NumberTableError: no such file, another format, damaged, or without headers.
    """

    def __init__(self, path: Path):
        self._path, self._lines = path, array.array("q")
        if not path.is_file():
            raise NumberTableError(f"{path}: no such file")
        if path.suffix not in (".csv", ".parquet"):
            raise NumberTableError(f"{path}: a file .csv or .parquet is needed")
        try:
            self.headers = self._headers_of_parquet() if path.suffix == ".parquet" else self._headers_of_csv()
        except (OSError, csv.Error, ValueError) as error:
            raise self._unreadable(error) from None
        parts = [header.partition("[") for header in self.headers]
        self.names = [name.strip() for name, _, _ in parts]
        self.units = [unit.rstrip("] ").strip() for _, _, unit in parts]

    def read(self, columns: Sequence[int]) -> np.ndarray:
        """The numbers in some columns (rows, columns), in the units of the file, finite.

        Raises:
            NumberTableError: a cell without a finite number, a row of another length, or a file that is cut off.
        """
        try:
            return self._read_parquet(columns) if self._path.suffix == ".parquet" else self._read_csv(columns)
        except (OSError, csv.Error, UnicodeDecodeError) as error:
            raise self._unreadable(error) from None

    def place(self, row: int) -> str:
        """File and line of a row that was read."""
        return f"{self._path}:{self._lines[row]}" if self._lines else f"{self._path}: row {row + 1}"

    def _unreadable(self, error: Exception) -> NumberTableError:
        if isinstance(error, NumberTableError):
            return error
        if self._path.suffix == ".parquet":
            return NumberTableError(f"{self._path}: is damaged or not a Parquet file")
        reason = "not a text file in UTF-8" if isinstance(error, UnicodeDecodeError) else str(error).splitlines()[0]
        return NumberTableError(f"{self._path}: cannot be read as CSV ({reason})")

    def _headers_of_parquet(self) -> list[str]:
        import pyarrow.parquet as pq

        schema = pq.read_schema(self._path)
        units = [(field.metadata or {}).get(b"unit", b"").decode() for field in schema]
        pairs = zip(schema.names, units, strict=True)
        return [name if "[" in name or unit in ("", "-") else f"{name} [{unit}]" for name, unit in pairs]

    def _headers_of_csv(self) -> list[str]:
        with self._path.open(encoding="utf-8-sig", newline="") as file:
            headers = [cell.strip() for cell in next(csv.reader(file), [])]
        if not any(headers):
            raise NumberTableError(f"{self._path}: is empty; its first line names the columns, such as `time [s]`")
        if len(headers) == 1 and ";" in headers[0]:
            raise NumberTableError(f"{self._path}:1: columns must be separated by commas, not semicolons")
        return headers

    def _read_parquet(self, columns: Sequence[int]) -> np.ndarray:
        import pyarrow as pa
        import pyarrow.parquet as pq

        try:
            data = pq.read_table(self._path)
        except (pa.ArrowException, ValueError) as error:
            raise self._unreadable(error) from None
        found = []
        for i in columns:
            kind, name = data.schema.types[i], self.headers[i]
            if not (pa.types.is_floating(kind) or pa.types.is_integer(kind)):
                raise NumberTableError(f"{self._path}: column `{name}` must hold numbers")
            values = data.column(i).to_numpy().astype(float)
            if not np.isfinite(values).all():
                place = self.place(int(np.argmax(~np.isfinite(values))))
                raise NumberTableError(f"{place}: column `{name}` has a missing or infinite value")
            found.append(values)
        return np.stack(found, axis=1) if found else np.zeros((0, 0))

    def _read_csv(self, columns: Sequence[int]) -> np.ndarray:
        rows, width = [], len(self.headers)
        with self._path.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.reader(file)
            next(reader)
            for row in (row for row in reader if row):
                self._lines.append(reader.line_num)
                if len(row) != width:
                    cut = "; the file seems to be cut off" if len(row) < width else ""
                    raise NumberTableError(f"{self.place(-1)}: {len(row)} values where the header has {width}{cut}")
                rows.append([self._number(row[i], i) for i in columns])
        with self._path.open("rb") as file:
            file.seek(-1, 2)
            if rows and file.read(1) not in b"\r\n":
                # "20.5" cut off as "20." would be read as a valid number
                raise NumberTableError(f"{self.place(-1)}: the last line has no end; the file seems to be cut off "
                                       "(add a line end if it is complete)")  # fmt: skip
        return np.array(rows, float).reshape(len(rows), len(columns))

    def _number(self, text: str, column: int) -> float:
        """The number in a cell of the row that is being read."""
        try:
            value, problem = float(text), "is not a finite number"
        except ValueError:
            value, problem = math.nan, "is not a number"
        if math.isfinite(value):
            return value
        problem = f'"{text.strip()}" {problem}' if text.strip() else "a number is missing; every row needs one"
        raise NumberTableError(f"{self.place(-1)}: column `{self.headers[column]}`: {problem}")
