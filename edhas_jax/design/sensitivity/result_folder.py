"""Folder of a sensitivity analysis: tables as Parquet files, the configuration, and the machine."""

from pathlib import Path

import pandas as pd
import pyarrow as pa

from edhas_jax.config.result_files import ResultFileError, check_files
from edhas_jax.config.writer import dump_config
from edhas_jax.design.sensitivity.analysis import SensitivityResult
from edhas_jax.design.sensitivity.config import SensitivityTask
from edhas_jax.simulation.run import Simulation

TABLES = ("local", "sobol", "morris")
POINTS_FILE, LOCAL_FILE, TASK_FILE, MACHINE_FILE = "points.parquet", "local.parquet", "sensitivity.yaml", "machine.yaml"


def save_sensitivity(task: SensitivityTask, result: SensitivityResult, folder: Path) -> None:
    """Write the tables, the configuration and the machine with every parameter; the folder is created if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    result.points.to_parquet(folder / POINTS_FILE)
    for name in TABLES:
        table = getattr(result, name)
        if table is not None:
            table.to_parquet(folder / f"{name}.parquet")
    (folder / TASK_FILE).write_text(task.text, encoding="utf-8")
    (folder / MACHINE_FILE).write_text(dump_config(task.machine, Simulation()), encoding="utf-8")


def open_sensitivity(folder: Path | str) -> SensitivityResult:
    """Read the tables of a sensitivity analysis.

    Raises:
        ResultFileError: the folder has none, or damaged ones.
    """
    folder = Path(folder)
    for name in (POINTS_FILE, LOCAL_FILE):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not the folder of a sensitivity analysis: {name} is missing")
    check_files(folder)
    try:
        tables = {n: pd.read_parquet(folder / f"{n}.parquet") for n in TABLES if (folder / f"{n}.parquet").is_file()}
        return SensitivityResult(pd.read_parquet(folder / POINTS_FILE), **tables)
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise ResultFileError(f"{folder}: unreadable or incomplete: {error}") from None
