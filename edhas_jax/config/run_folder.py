"""Run folders: the results of one simulation on disk together with the configuration that reproduces them."""

import dataclasses
import datetime
import json
import math
import os
import platform
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

import edhas_jax
from edhas_jax.config.machine_config import read_config
from edhas_jax.config.result_files import ResultFileError, ResultFiles, check_files, report_write_errors
from edhas_jax.config.writer import dump_config
from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.core.literal_text import file_name
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.simulation.metrics import RunTooShortError
from edhas_jax.simulation.run import Run
from edhas_jax.simulation.run_checks import check_run
from edhas_jax.simulation.validity import Status

FORMAT_VERSION = 1
SIGNALS_FILE = "timeseries.parquet"
LEDGER_FILE = "ledger.parquet"
METRICS_FILE = "metrics.json"
CONFIG_FILE = "config.yaml"
FIGURE_FILE = "figure.png"
MANIFEST_FILE = "run.json"
RUN_FILES = (SIGNALS_FILE, LEDGER_FILE, METRICS_FILE, CONFIG_FILE, FIGURE_FILE, MANIFEST_FILE)
ENERGY_PREFIX, VOLUME_PREFIX = "energy: ", "volume: "  # of the columns of the ledger


def unused_folder(parent: Path, name: str) -> Path:
    """The first of `parent/name`, `parent/name-2`, `parent/name-3`, … that does not exist; `name` is no path."""
    folder, n = named_folder(parent, name), 1
    while folder.exists():
        n += 1
        folder = parent / f"{file_name(name)}-{n}"
    return folder


def named_folder(parent: Path, name: str) -> Path:
    """The folder `parent/name`, where `name` is any text and no path."""
    return parent / file_name(name)


def save_run(run: Run, folder: str | Path, overwrite: bool = False, figure: bool = True) -> Path:
    """Write a run folder: signals, ledger, metrics, configuration, manifest and figure.

    A new folder is made under a temporary name and renamed when it is complete, so that no partial folder remains. In
    an existing one the files of the earlier run are replaced, and all others stay.

    Args:
        run: the simulation result.
        folder: the folder to write; signals and ledger are Parquet files in SI with the units in their schemas.
        overwrite: whether an existing run folder may be replaced.
        figure: whether a picture of the run is written as well.

    Returns:
        The folder.

    Raises:
        ResultFileError: the folder exists and `overwrite` is false, or is not a run folder, or cannot be written.
    """
    folder = Path(folder)
    replaced = ResultFiles(folder, overwrite, RUN_FILES)
    if folder.exists() and not (folder / MANIFEST_FILE).exists():
        raise ResultFileError(f"{folder}: is not a run folder, so it is not overwritten")
    with report_write_errors(folder):
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
        try:
            written = ResultFiles(temporary, True, RUN_FILES)
            written.begin()
            _write_files(temporary, run, figure)
            written.finish()
            os.chmod(temporary, 0o755)
            if not folder.exists():
                temporary.rename(folder)
            else:
                replaced.begin()
                for file in temporary.iterdir():
                    if file.name in RUN_FILES:
                        os.replace(file, folder / file.name)
                replaced.finish()
        finally:
            shutil.rmtree(temporary, ignore_errors=True)
    return folder


def _write_files(folder: Path, run: Run, figure: bool) -> None:
    """Write all files of a run folder."""
    pq.write_table(_table(run.signals, {n: run.machine.signals[n].unit for n in run.signals}), folder / SIGNALS_FILE)
    columns = {"time": run.signals["time"]}
    units = {"time": "s"}
    groups = {ENERGY_PREFIX + n: group for n, group in run.row_groups().items()}
    for prefix, unit, entries in ((ENERGY_PREFIX, "J", run.energy), (VOLUME_PREFIX, "m^3", run.volume)):
        columns |= {prefix + n: v for n, v in entries.items()}
        units |= {prefix + n: unit for n in entries}
    pq.write_table(_table(columns, units, groups), folder / LEDGER_FILE)
    try:
        metrics = {n: {"value": m.value, "unit": m.unit, "doc": m.doc} for n, m in run.metrics.items()}
    except RunTooShortError:
        metrics = {}
    validity = {"status": str(run.status), "valid": run.valid, "reason": run.reason}
    write_json(folder / METRICS_FILE, replace_nonfinite(validity | metrics))
    (folder / CONFIG_FILE).write_text(dump_config(run.machine, run.simulation), encoding="utf-8")
    manifest = {
        "format": FORMAT_VERSION,
        "edhas_jax": edhas_jax.__version__,
        "jax": jax.__version__,
        "python": platform.python_version(),
        "device": str(jax.devices()[0].device_kind),
        "platform": jax.default_backend(),
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "step": run.step,
        "step_note": run.step_note,
        **validity,
        "energy_residual": run.energy_residual(),
        "volume_residual": run.volume_residual(),
    }
    if figure:
        run.plot().savefig(folder / FIGURE_FILE, dpi=110)
    write_json(folder / MANIFEST_FILE, replace_nonfinite(manifest))


def _table(columns: dict, units: dict[str, str], groups: dict[str, str] | None = None) -> pa.Table:
    """A table of float64 columns with the unit of each, and its group if it has one, in its metadata."""
    of_group = {name: {"group": group} for name, group in (groups or {}).items()}
    fields = [pa.field(n, pa.float64(), metadata={"unit": units[n]} | of_group.get(n, {})) for n in columns]
    return pa.table([pa.array(np.asarray(v, float)) for v in columns.values()], schema=pa.schema(fields))


def write_json(path: Path, value: dict) -> None:
    """Write a JSON file atomically; numbers must be finite, see `replace_nonfinite`."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def replace_nonfinite(value: Any) -> Any:
    """Replace every NaN or infinite number in nested data by None, since JSON has no notation for them."""
    if isinstance(value, dict):
        return {k: replace_nonfinite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [replace_nonfinite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def open_run(folder: str | Path, trust: Iterable[str | Path] = ()) -> Run:
    """Read a run folder, without running code that it names.

    Args:
        folder: a folder that `save_run` has written.
        trust: Python files (or modules) of your own that may run to make the machine. Without them signals, metrics,
            ledger and picture are there, and `simulate` of the machine says what it needs.

    Returns:
        The run with its machine, settings, signals and ledgers in SI.

    Raises:
        ResultFileError: not a run folder, a file is missing or unreadable, or it has a later format.
    """
    folder = Path(folder)
    for name in (MANIFEST_FILE, SIGNALS_FILE, LEDGER_FILE, CONFIG_FILE):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not a run folder: {name} is missing")
    check_files(folder)
    try:
        manifest = json.loads((folder / MANIFEST_FILE).read_text(encoding="utf-8"))
        if manifest["format"] > FORMAT_VERSION:
            reason = f"written by the later version {manifest['edhas_jax']}; this one reads format {FORMAT_VERSION}"
            raise ResultFileError(f"{folder}: {reason}")
        step, note = float(manifest["step"]), str(manifest["step_note"])
        # a run of a former version has no status
        status = (Status[manifest["status"].upper()], str(manifest["reason"])) if "status" in manifest else None
        tables = [pq.read_table(folder / name) for name in (SIGNALS_FILE, LEDGER_FILE)]
        signals, ledger = ({n: np.array(table[n]) for n in table.column_names} for table in tables)
        groups = _groups(tables[1].schema)
    except ResultFileError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError, pa.ArrowException) as error:
        raise ResultFileError(f"{folder}: unreadable or incomplete: {error}") from None
    trusted = dataclasses.replace(TrustedCode.of(trust), remembered=False)
    config = read_config(folder / CONFIG_FILE, trust=trusted, is_result=True)
    energy, volume = (
        {n.removeprefix(prefix): v for n, v in ledger.items() if n.startswith(prefix)}
        for prefix in (ENERGY_PREFIX, VOLUME_PREFIX)
    )
    run = Run(config.machine, config.simulation, signals, energy, volume, step, note, groups)
    status = status or check_run(run.record, run.energy_residual(), run.volume_residual())
    return dataclasses.replace(run, status=status[0], reason=status[1])


def _groups(schema: pa.Schema) -> dict[str, str] | None:
    """The group of each row of the energy balance, from the schema of the ledger; None in one of an older version."""
    rows = {f.name.removeprefix(ENERGY_PREFIX): f.metadata or {} for f in schema if f.name.startswith(ENERGY_PREFIX)}
    if not all(b"group" in metadata for metadata in rows.values()):
        return None
    return {name: metadata[b"group"].decode() for name, metadata in rows.items()}
