"""The table of a sweep from its chunks, a window of designs at a time: a few chunks are in memory, never all."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.design.sweep.table import with_results

WINDOW = 131_072  # designs: a row group of the table


class Window(NamedTuple):
    """The results of consecutive designs: the first one's row, and by metric the values (SI) of all."""

    first: int
    metrics: dict[str, np.ndarray]


def windows(
    rows: Sequence[np.ndarray], read: Callable[[int], Mapping[str, np.ndarray]], count: int, size: int | None = None
) -> Iterator[Window]:
    """The results of all designs in their order.

    A chunk is read when its first design is reached and forgotten after its last one.

    Args:
        rows: by chunk the rows of its designs in the table, ascending.
        read: the results of a chunk, by its number.
        count: of all designs.
        size: designs of a window; None: `WINDOW`.
    """
    size = size or WINDOW
    waiting = sorted(range(len(rows)), key=lambda number: -int(rows[number][0]))
    here: dict[int, Mapping[str, np.ndarray]] = {}
    for first in range(0, count, size):
        last = min(first + size, count)
        while waiting and rows[waiting[-1]][0] < last:
            number = waiting.pop()
            here[number] = read(number)
        metrics: dict[str, np.ndarray] = {}
        for number, columns in here.items():
            begin, end = np.searchsorted(rows[number], (first, last))
            for name, column in columns.items():
                target = metrics.setdefault(name, np.full(last - first, np.nan))
                target[rows[number][begin:end] - first] = column[begin:end]
        here = {number: columns for number, columns in here.items() if rows[number][-1] >= last}
        yield Window(first, metrics)


def write_table(designs: pa.Table, parts: Iterable[Window], file: Path) -> None:
    """Write the table of a sweep.

    Args:
        designs: the designs, a row each.
        parts: their results, as `windows` gives them.
        file: to be written.
    """
    writer = None
    try:
        for first, metrics in parts:
            part = with_results(designs.slice(first, len(metrics["status"])), metrics)
            writer = writer or pq.ParquetWriter(file, part.schema)
            writer.write_table(part, row_group_size=WINDOW)
    finally:
        if writer is not None:
            writer.close()
