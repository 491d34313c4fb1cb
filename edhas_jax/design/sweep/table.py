"""Table of a sweep: a row per design with parameters and metrics in SI, their units in the schema; its summary."""

import dataclasses
import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.units import display_unit, format_result, from_si
from edhas_jax.machine.interface.metrics import in_order, metrics_of_batch
from edhas_jax.machine.metrics import METRICS
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.validity import REASONS, Status

TABLE_FILE = "table.parquet"
DECLARED = b"metrics"  # in the schema of a table of designs: what is known of each metric of their machine
TEXT_COLUMNS = ["status", "reason"]  # a few texts many times: read as numbers of a dictionary
NOT_RUN = "not_run"
WINDOW = 131_072  # designs: a row group of the table
# by status of a design what it means
OUTCOMES = {NOT_RUN: "not run yet"} | {status.name.lower(): REASONS[status] for status in Status}
CONVERGENCE_COLUMNS = {
    "cycles": "cycles that were run",
    "residual": "larger change of the metrics over the last two cycles",
}


class Field(NamedTuple):
    """What is known of a column: SI unit, unit in which it is shown, meaning, and the rank of a metric."""

    unit: str
    shown: str
    doc: str
    rank: int = 0


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """The result of a sweep, finished or not.

    Attributes:
        frame: a row per design in SI, with all columns or those that were asked for; its column `status` is "ok", the
            reason of a failure, or "not_run". Only designs that are "ok" have metrics, the others NaN.
        parameters: columns that are varied parameters.
        metrics: columns that are metrics.
        fields: what is known of each column.
        manifest: description of the sweep and its state.
    """

    frame: pd.DataFrame
    parameters: tuple[str, ...]
    metrics: tuple[str, ...]
    fields: Mapping[str, Field]
    manifest: Mapping[str, Any]

    @property
    def done(self) -> int:
        """The number of designs that have been run."""
        return int((self.frame["status"] != NOT_RUN).sum())

    @property
    def leading(self) -> list[str]:
        """The metrics, in the order in which they are shown where only some are."""
        return in_order(self.metrics, lambda name: self.fields[name].rank)

    def shown(self, name: str) -> np.ndarray:
        """A column in the unit it is shown in, shape (designs,)."""
        about = self.fields[name]
        return from_si(self.frame[name].to_numpy(float), about.unit, about.shown)


def sweep_table(
    machine: Rig, designs: Mapping[str, np.ndarray], metrics: Mapping[str, np.ndarray] | None = None
) -> pa.Table:
    """Build the Arrow table of designs and, if given, their results.

    Args:
        machine: gives the units and meanings of parameters and metrics.
        designs: by parameter a column of values (SI), shape (designs,).
        metrics: by metric a column of values (SI), with status, cycles and residual; NaN for a design that has not
            been run.
    """
    columns = []
    for name, values in designs.items():
        p, _ = find_parameter(machine, name)
        shown = display_unit(p.unit, float(np.abs(values).max())) or "-"
        columns.append(_column(name, values, role="parameter", unit=p.unit, shown=shown, doc=p.doc))
    declared = {n: (k.unit, k.display_unit, k.doc, k.rank) for n, k in metrics_of_batch(machine).items()}
    schema = pa.schema([field for field, _ in columns], metadata={DECLARED: json.dumps(declared)})
    table = pa.table([values for _, values in columns], schema=schema)
    return table if metrics is None else with_results(table, metrics)


def _declared(table: pa.Table) -> dict[str, Field]:
    """What is known of each metric; a table of an older version does not say it, and is of a rig of the package."""
    text = (table.schema.metadata or {}).get(DECLARED)
    if text is None:
        return {n: Field(k.unit, k.display_unit, k.doc, k.rank) for n, k in METRICS.items()}
    return {name: Field(*about) for name, about in json.loads(text).items()}


def with_results(table: pa.Table, metrics: Mapping[str, np.ndarray]) -> pa.Table:
    """Add the results to a table of designs.

    The metrics of a design that is not OK are NaN, so that no selection by a metric finds it.

    Args:
        table: the designs, a row each, from `sweep_table`.
        metrics: as for `sweep_table`.
    """
    columns, ok = [], np.asarray(metrics["status"], float) == Status.OK
    for name, about in _declared(table).items():
        if name in metrics:
            known = about._asdict() | {"rank": str(about.rank)}
            columns.append(_column(name, np.where(ok, metrics[name], np.nan), role="metric", **known))
    for name, doc in CONVERGENCE_COLUMNS.items():
        columns.append(_column(name, metrics[name], role="account", unit="-", shown="-", doc=doc))
    codes, place = np.unique(np.nan_to_num(metrics["status"], nan=-1.0).astype(int), return_inverse=True)
    names = [NOT_RUN if code < 0 else Status(code).name.lower() for code in codes]
    reasons = [OUTCOMES[name] for name in names]
    for name, texts, doc in (("status", names, "outcome of the run"), ("reason", reasons, "why")):
        columns.append(_column(name, pa.array(texts, pa.string()).take(pa.array(place)), pa.string(), doc=doc))
    for field, values in columns:
        table = table.append_column(field, values)
    return table


def _column(name: str, values, kind: pa.DataType | None = None, **metadata: str) -> tuple[pa.Field, pa.Array]:
    """A column, of numbers unless `kind` says otherwise, with what is known of it."""
    column = pa.array(np.asarray(values, float) if kind is None else values, kind)
    return pa.field(name, column.type, metadata={k: v for k, v in metadata.items() if v}), column


def to_result(data: pa.Table, manifest: Mapping[str, Any], whole: pa.Schema | None = None) -> SweepResult:
    """A sweep's Arrow table as a result, with units and meanings from its schema.

    Where `data` has some columns only, `whole` is the schema of all; the numbers may then be those of `data`, not to be
    written to.
    """
    schema = data.schema if whole is None else whole
    metadata = {f.name: {k.decode(): v.decode() for k, v in (f.metadata or {}).items()} for f in schema}
    fields = {
        n: Field(t.get("unit", "-"), t.get("shown", "-"), t.get("doc", ""), int(t.get("rank", 0)))
        for n, t in metadata.items()
    }
    parameters, metrics = (tuple(n for n, t in metadata.items() if t.get("role") == r) for r in ("parameter", "metric"))
    columns = {
        name: column.cast(pa.string()).to_pandas() if pa.types.is_dictionary(column.type)
        else column.to_numpy(zero_copy_only=False)
        for name, column in zip(data.column_names, data.columns, strict=True)
    }  # fmt: skip
    return SweepResult(pd.DataFrame(columns, copy=whole is None), parameters, metrics, fields, manifest)


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


def summary_of_parts(parts: Iterable[SweepResult]) -> Summary:
    """The summary of a result that comes in parts; one part is in memory at a time."""
    statuses: Counter[tuple[str, str]] = Counter()
    ends, part, total = [], None, 0
    for part in parts:
        total += len(part.frame)
        statuses.update(part.frame.groupby(["status", "reason"], sort=False).size().to_dict())
        numbers = part.frame[[*part.parameters, *part.metrics]].astype(float)
        ends.append(numbers.where(np.isfinite(numbers)).agg(["min", "max"]))
    if part is None:
        raise ValueError("a sweep without designs")
    low, high = (found := pd.concat(ends)).min(), found.max()
    tones = {"ok": Tone.GOOD, NOT_RUN: Tone.CAUTION}
    counts = [(status, int(n), reason) for (status, reason), n in statuses.items()]
    rows = [(Toned(s, tones.get(s, Tone.BAD)), f"{n:,}", reason) for s, n, reason in counts]
    records = [{"status": s, "designs": n, "meaning": reason} for s, n, reason in counts]
    ranges = [
        {"name": name, "role": role, "from": low[name], "to": high[name], "unit": part.fields[name][0]}
        for role, names in (("parameter", part.parameters), ("metric", part.metrics))
        for name in names
        if np.isfinite(low[name])
    ]
    texts = []
    for r in ranges:
        about = part.fields[r["name"]]
        ends = (format_result(float(r[end]), about.unit, about.shown) for end in ("from", "to"))
        texts.append((r["name"], r["role"], *ends))
    title = f"{part.manifest.get('name') or 'sweep'}: {total:,} designs of {', '.join(part.parameters)}"
    return Summary(title, (
        SummaryTable.of("statuses", ("status", "designs", "meaning"), rows, records),
        SummaryTable.of("ranges", ("name", "", "from", "to"), texts, ranges),
    ))  # fmt: skip
