"""Folder of a sizing result: configurations of the sized machines, the result as JSON, the path of every start."""

import dataclasses
import json
from pathlib import Path

import pandas as pd
import pyarrow as pa

from edhas_jax.config.result_files import ResultFileError, check_files
from edhas_jax.config.writer import dump_config
from edhas_jax.design.sizing.config import SizingTask
from edhas_jax.design.sizing.size import SizedMachine, SizingResult
from edhas_jax.simulation.run import Simulation

RESULT_FILE, PATH_FILE, TASK_FILE, START_FILE = "result.json", "path.parquet", "sizing.yaml", "start.yaml"


def save_sizing(task: SizingTask, result: SizingResult, folder: Path) -> list[Path]:
    """Write a result into a folder, created if it is missing.

    Returns:
        The configurations of the sized machines, which `edhas simulate` runs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    simulation = Simulation(step=task.settings.step)
    count = len(result.machines)
    names = ["sized.yaml"] if count == 1 else [f"sized_{k + 1}.yaml" for k in range(count)]
    for name, sized in zip(names, result.machines, strict=True):
        (folder / name).write_text(dump_config(sized.machine, simulation), encoding="utf-8")
    (folder / START_FILE).write_text(dump_config(task.machine, simulation), encoding="utf-8")
    (folder / TASK_FILE).write_text(task.text, encoding="utf-8")
    result.path.to_parquet(folder / PATH_FILE)
    content = {
        "start": _as_json(result.start),
        "machines": [_as_json(sized) | {"config": name} for name, sized in zip(names, result.machines, strict=True)],
        "share of starts within 1 %": result.share_near_best,
        "machine_seconds": result.machine_seconds,
        "seconds": result.seconds,
    }
    (folder / RESULT_FILE).write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return [folder / name for name in names]


def _as_json(sized: SizedMachine) -> dict:
    row = dataclasses.asdict(dataclasses.replace(sized, machine=None, metrics=None))
    return {n: v for n, v in row.items() if v is not None} | {"metrics": sized.metrics.to_dict("records")}


def open_sizing(folder: Path | str) -> tuple[dict, pd.DataFrame]:
    """Read a sizing result.

    Returns:
        The content of result.json (SI), and the path of every start: a row per iteration and start.

    Raises:
        ResultFileError: the folder holds no sizing result, or a damaged one.
    """
    folder = Path(folder)
    for name in (RESULT_FILE, PATH_FILE):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not the folder of a sizing: {name} is missing")
    check_files(folder)
    try:
        content = json.loads((folder / RESULT_FILE).read_text(encoding="utf-8"))
        path = pd.read_parquet(folder / PATH_FILE)
    except (OSError, ValueError, KeyError, TypeError, RecursionError, pa.ArrowException) as error:
        raise ResultFileError(f"{folder}: unreadable or incomplete: {error}") from None
    if not isinstance(content, dict):
        raise ResultFileError(f"{folder}: {RESULT_FILE} is damaged or not one of a sizing")
    return content, path
