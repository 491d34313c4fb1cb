"""Files that were dropped, and the check of a campaign's data, for the page."""

import functools
from collections.abc import Callable
from typing import Any

import numpy as np

from edhas_jax.config.tables.table import Table, TableError
from edhas_jax.config.tables.table_reader import read_table
from edhas_jax.core.remark import Remark
from edhas_jax.core.units import UnitError, exact_quantity
from edhas_jax.machine.rigs import RIGS
from edhas_jax.measurements.campaign import BenchRun, Campaign
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.table_guess import GuessedColumn, Role, guess_columns, guess_sine
from edhas_jax.simulation.integrator import signal_names
from edhas_jax.workbench.thinning import thinned
from edhas_jax.workbench.workspace import Workspace, WorkspaceError

GAP = 2.5  # sample intervals, from which a hole in the time is marked
MAX_MARKS = 200


class DataCalculations:
    """Reads tables and checks them.

    Args:
        workspace: the folder.
        say: called with a sentence on the progress.
    """

    def __init__(self, workspace: Workspace, say: Callable[[str], None]):
        self._workspace, self._say = workspace, say
        self._records: tuple[tuple, Campaign, Campaign] | None = None

    def table(self, name: str, rig: str, width: int) -> dict[str, Any]:
        """The columns of a file with what they seem to be, what is wrong with the file, and its curves.

        Raises:
            WorkspaceError: the file holds no table that can be used.
        """
        remarks: list[Remark] = []
        try:
            table = read_table(self._workspace.inside(name), remarks.append)
        except TableError as error:
            where = f"{name}:{error.line}" if error.line else name
            raise WorkspaceError("\n".join([f"{where}: {error}", *(r.sentence for r in remarks)])) from None
        guesses = guess_columns(table, signals_of(rig))
        index = np.arange(len(table.lines), dtype=float)
        curves = {}
        for column_name, column in table.columns.items():
            chosen = thinned(index, column.values, 0.0, float(len(index)), width)
            curves[column_name] = {"x": chosen, "y": column.values[chosen]}
        columns = []
        for guess in guesses:
            values = table.columns[guess.column].values
            valid = values[np.isfinite(values)]
            span = (float(valid.min()), float(valid.max())) if len(valid) else (np.nan, np.nan)
            columns.append(
                guess._asdict() | {"role": guess.role.value, "span": span, "missing": int(np.isnan(values).sum())}
            )
        return {
            "columns": columns, "sine": _sine(table, guesses), "samples": len(table.lines), "curves": curves,
            "remarks": [(r.line, r.sentence) for r in remarks]
            + [(c.fault.line, str(c.fault)) for c in table.columns.values() if c.fault],
        }  # fmt: skip

    def sine(self, name: str, columns: list[dict[str, Any]]) -> dict[str, Any] | None:
        """The sine that has driven the run of a file, see `guess_sine`, as texts; None where there is none.

        Args:
            name: the file.
            columns: what its columns are, as from `table`, perhaps changed.
        """
        known = [GuessedColumn(**{field: row[field] for field in GuessedColumn._fields}) for row in columns]
        known = [column._replace(role=Role(column.role)) for column in known]
        try:
            return _sine(read_table(self._workspace.inside(name), lambda remark: None), known)
        except TableError:  # said where the file was dropped
            return None

    def record(self, run: str, signal: str, width: int) -> dict[str, Any]:
        """A signal of a run as recorded, with the samples that are left out and the gaps of its time."""
        raw, checked = self._campaigns()
        recorded = next((r for r in raw.runs if r.name == run), None)
        if recorded is None or signal not in recorded.signals:
            raise WorkspaceError(f"{run} has no {signal}")
        values = raw.machine.signals[signal].shown(recorded.signals[signal])
        used = next((r for r in checked.runs if r.name == run), None)
        kept = used.signals.get(signal) if used is not None else None
        left_out = np.isfinite(values) if kept is None else np.isfinite(values) & ~np.isfinite(kept)
        index = thinned(recorded.time, values, -np.inf, np.inf, width)
        bad = np.flatnonzero(left_out)[:MAX_MARKS]
        return {
            "x": recorded.time[index], "y": values[index], "unit": raw.machine.signals[signal].display_unit,
            "left_out": (recorded.time[bad], values[bad]),
            "gaps": self._gaps(recorded), "limits": self._limits(values),
        }  # fmt: skip

    def _campaigns(self) -> tuple[Campaign, Campaign]:
        """The campaign as read, and after the check."""
        self._workspace.require_files_inside()
        key = self._workspace.campaign_mark()
        if self._records is None or self._records[0] != key:
            self._say("reading and checking the data")
            raw = read_campaign(self._workspace.folder)
            self._records = key, raw, checked_campaign(raw)
        return self._records[1], self._records[2]

    @staticmethod
    def _gaps(run: BenchRun) -> list[tuple[float, float]]:
        steps = np.diff(run.time)
        at = np.flatnonzero(steps > GAP * run.interval)[:MAX_MARKS]
        return [(float(run.time[k]), float(run.time[k + 1])) for k in at]

    @staticmethod
    def _limits(values: np.ndarray) -> list[float]:
        """The ends of the range at which the signal stays for several samples, as one that is cut off does."""
        valid = values[np.isfinite(values)]
        if len(valid) < 10:
            return []
        ends = (float(valid.min()), float(valid.max()))
        return [end for end in ends if np.mean(valid == end) > 0.01 and ends[0] < ends[1]]


def _sine(table: Table, columns: list[GuessedColumn]) -> dict[str, Any] | None:
    try:
        found = guess_sine(table, columns)
    except UnitError:  # said beside the column
        return None
    if found is None:
        return None
    texts = {"frequency": exact_quantity(found.frequency, "Hz")}
    texts |= {"amplitude": exact_quantity(found.amplitude, "m")} if np.isfinite(found.amplitude) else {}
    return {"column": found.column, "conditions": texts}


@functools.cache
def signals_of(rig: str) -> tuple[str, ...]:
    """The signals of a rig."""
    machine = RIGS[rig]()
    found = signal_names(machine)
    return tuple(name for name in machine.signals if name in found and name != "time")
