"""The table of a sweep: a row per design, parameters and metrics in SI, with units in its schema."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from edhas_jax.core.units import display_unit, from_si
from edhas_jax.design.batch.batch import REASONS, Status
from edhas_jax.machine.parameters import find_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import METRICS

TABLE = "table.parquet"
NOT_RUN = "not_run"
ACCOUNT = {"cycles": "cycles that were run", "residual": "larger change of the metrics over the last two cycles"}


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """A sweep that was read back.

    `frame` has a row per design in SI, `status` "ok" or what became of the design ("not_run" while the sweep is
    unfinished); `fields` tells SI unit, shown unit and meaning of each column.
    """

    frame: pd.DataFrame
    parameters: tuple[str, ...]
    metrics: tuple[str, ...]
    fields: Mapping[str, tuple[str, str, str]]
    manifest: Mapping[str, Any]

    @property
    def done(self) -> int:
        """How many designs have been run."""
        return int((self.frame["status"] != NOT_RUN).sum())

    def shown(self, name: str) -> np.ndarray:
        """A column in the unit it is shown in."""
        unit, shown, _ = self.fields[name]
        return from_si(self.frame[name].to_numpy(float), unit, shown)


def table_of(machine: Rig, designs: Mapping[str, np.ndarray], metrics: Mapping[str, np.ndarray] | None = None):
    """An Arrow table of designs, and of what they gave; rows without a status were not run."""
    fields, columns = [], []

    def add(name, values, kind=None, **told):
        columns.append(pa.array(values, kind))
        fields.append(pa.field(name, columns[-1].type, metadata={k: v for k, v in told.items() if v}))

    for name, values in designs.items():
        p, _ = find_parameter(machine, name)
        shown = display_unit(p.unit, float(np.abs(values).max())) or "-"
        add(name, np.asarray(values, float), role="parameter", unit=p.unit, shown=shown, doc=p.doc)
    if metrics is not None:
        for name in (n for n in METRICS if n in metrics):
            unit, shown, doc = METRICS[name]
            add(name, np.asarray(metrics[name], float), role="metric", unit=unit, shown=shown, doc=doc)
        for name, doc in ACCOUNT.items():
            add(name, np.asarray(metrics[name], float), role="account", unit="-", shown="-", doc=doc)
        known = [None if np.isnan(s) else Status(int(s)) for s in metrics["status"]]
        add("status", [NOT_RUN if s is None else s.name.lower() for s in known], pa.string(), doc="what became of it")
        add("reason", ["not run yet" if s is None else REASONS[s] for s in known], pa.string(), doc="why")
    return pa.table(columns, schema=pa.schema(fields))


def frame_of(data: pa.Table) -> pd.DataFrame:
    """The same as a data frame."""
    return pd.DataFrame({name: data[name].to_numpy(zero_copy_only=False) for name in data.column_names})


def result_of(data: pa.Table, manifest: Mapping[str, Any]) -> SweepResult:
    """The same with the meaning of its columns."""
    told = {f.name: {k.decode(): v.decode() for k, v in (f.metadata or {}).items()} for f in data.schema}
    fields = {n: (t.get("unit", "-"), t.get("shown", "-"), t.get("doc", "")) for n, t in told.items()}
    parameters, metrics = (tuple(n for n, t in told.items() if t.get("role") == r) for r in ("parameter", "metric"))
    return SweepResult(frame_of(data), parameters, metrics, fields, manifest)
