"""Run folders: results on disk, complete or not there, that reopen with the configuration that made them."""

import datetime
import json
import math
import os
import platform
import shutil
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

import edhas_jax
from edhas_jax.config.machine_config import read_config
from edhas_jax.config.writer import dump_config
from edhas_jax.core.atomic_file import whole_file
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.simulation.metrics import TooShort
from edhas_jax.simulation.run import Run

FORMAT = 1
SERIES, LEDGER, METRICS, CONFIG, FIGURE, MANIFEST = (
    "timeseries.parquet", "ledger.parquet", "metrics.json", "config.yaml", "figure.png", "run.json",
)  # fmt: skip


class ResultFileError(ValueError):
    """A folder cannot be written, or is not a run folder that can be read."""


def unused_folder(parent: Path, name: str) -> Path:
    """`parent/name`, or the first of `parent/name-2`, `-3`, … that does not exist."""
    folder, n = parent / name, 1
    while folder.exists():
        n += 1
        folder = parent / f"{name}-{n}"
    return folder


def require_new_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that exists, unless it may be overwritten; worth asking before a long run.

    Raises:
        ResultFileError: the folder exists and `overwrite` is false.
    """
    if folder.exists() and not overwrite:
        raise ResultFileError(f"{folder}: exists already; nothing was written. Name another folder or add --overwrite")


def save_run(run: Run, folder: str | Path, overwrite: bool = False, figure: bool = True) -> Path:
    """Write a run folder: series and ledger (Parquet, units in the schema), metrics, configuration, figure, manifest.

    The folder appears at once when everything is in it; nothing half-written is left behind.

    Raises:
        ResultFileError: the folder exists and `overwrite` is false, or is not a run folder, or cannot be written.
    """
    folder = Path(folder)
    require_new_folder(folder, overwrite)
    if folder.exists() and not (folder / MANIFEST).exists():
        raise ResultFileError(f"{folder}: is not a run folder, so it is not overwritten")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise ResultFileError(f"{folder}: cannot be written: {error.strerror}") from None
    try:
        _fill(scratch, run, figure)
        os.chmod(scratch, 0o755)
        if folder.exists():
            shutil.rmtree(folder)
        scratch.rename(folder)
    except OSError as error:
        raise ResultFileError(f"{folder}: cannot be written: {error.strerror}") from None
    finally:
        shutil.rmtree(scratch, ignore_errors=True)
    return folder


def _fill(folder: Path, run: Run, figure: bool) -> None:
    pq.write_table(_table(run.signals, {n: SIGNALS[n].unit for n in run.signals}), folder / SERIES)
    columns = {"time": run.signals["time"]}
    columns |= {f"energy: {n}": v for n, v in run.energy.items()} | {f"volume: {n}": v for n, v in run.volume.items()}
    units = {n: {"e": "J", "v": "m^3", "t": "s"}[n[0]] for n in columns}
    pq.write_table(_table(columns, units), folder / LEDGER)
    try:
        metrics = {n: {"value": m.value, "unit": m.unit, "doc": m.doc} for n, m in run.metrics.items()}
    except TooShort:
        metrics = {}
    write_json(folder / METRICS, metrics)
    (folder / CONFIG).write_text(dump_config(run.machine, run.simulation), encoding="utf-8")
    manifest = {
        "format": FORMAT,
        "edhas_jax": edhas_jax.__version__,
        "jax": jax.__version__,
        "python": platform.python_version(),
        "device": str(jax.devices()[0].device_kind),
        "platform": jax.default_backend(),
        "xla_flags": os.environ.get("XLA_FLAGS", ""),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "step": run.step,
        "step_note": run.step_note,
        "energy_residual": run.energy_residual(),
        "volume_residual": run.volume_residual(),
    }
    if figure:
        run.plot().savefig(folder / FIGURE, dpi=110)
    write_json(folder / MANIFEST, manifest)


def _table(columns: dict, units: dict[str, str]) -> pa.Table:
    fields = [pa.field(n, pa.float64(), metadata={"unit": units[n]}) for n in columns]
    return pa.table([pa.array(np.asarray(v, float)) for v in columns.values()], schema=pa.schema(fields))


def write_json(path: Path, value: dict) -> None:
    """Write plain data to a file that is either whole or not there."""
    with whole_file(path) as beside:
        beside.write_text(json.dumps(value, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def replace_nonfinite(value: Any) -> Any:
    """The same data with null for every number that is not finite, which JSON has no word for."""
    if isinstance(value, dict):
        return {k: replace_nonfinite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [replace_nonfinite(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def open_run(folder: str | Path) -> Run:
    """Read a run folder back.

    Raises:
        ResultFileError: not a run folder, a file is missing or unreadable, or it was written by a later format.
    """
    folder = Path(folder)
    for name in (MANIFEST, SERIES, LEDGER, CONFIG):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not a run folder: {name} is missing")
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        if manifest["format"] > FORMAT:
            version = manifest["edhas_jax"]
            raise ResultFileError(f"{folder}: written by a later version ({version}); this one reads format {FORMAT}")
        signals = _columns(pd.read_parquet(folder / SERIES))
        books = _columns(pd.read_parquet(folder / LEDGER))
    except ResultFileError:
        raise
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        raise ResultFileError(f"{folder}: unreadable or half-written: {error}") from None
    config = read_config(folder / CONFIG)
    energy = {n.removeprefix("energy: "): v for n, v in books.items() if n.startswith("energy: ")}
    volume = {n.removeprefix("volume: "): v for n, v in books.items() if n.startswith("volume: ")}
    return Run(config.machine, config.simulation, signals, energy, volume, manifest["step"], manifest["step_note"])


def _columns(table: pd.DataFrame) -> dict[str, np.ndarray]:
    return {n: table[n].to_numpy() for n in table.columns}
