"""Sizing results on disk: configurations to simulate, the design and its path, what held it back."""

import dataclasses
import json
from pathlib import Path

import pandas as pd

from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.config.writer import dump_config
from edhas_jax.design.sizing.config import Sizing
from edhas_jax.design.sizing.sizing import SizingResult
from edhas_jax.simulation.run import Simulation

RESULT, PATH, TASK, START = "result.json", "path.parquet", "sizing.yaml", "start.yaml"


def save_sizing(task: Sizing, result: SizingResult, folder: Path) -> list[Path]:
    """Write a result; the configurations of its machines, which `edhas simulate` runs, are returned."""
    folder.mkdir(parents=True, exist_ok=True)
    simulation = Simulation(step=task.settings.step)
    count = len(result.machines)
    names = ["sized.yaml"] if count == 1 else [f"sized_{k + 1}.yaml" for k in range(count)]
    for name, sized in zip(names, result.machines, strict=True):
        (folder / name).write_text(dump_config(sized.machine, simulation), encoding="utf-8")
    (folder / START).write_text(dump_config(task.machine, simulation), encoding="utf-8")
    (folder / TASK).write_text(task.text, encoding="utf-8")
    result.path.to_parquet(folder / PATH)
    told = {
        "start": _told(result.start),
        "machines": [_told(sized) | {"config": name} for name, sized in zip(names, result.machines, strict=True)],
        "share of starts within 1 %": result.alike,
        "machine_seconds": result.machine_seconds,
        "seconds": result.seconds,
    }
    (folder / RESULT).write_text(json.dumps(told, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return [folder / name for name in names]


def _told(sized) -> dict:
    row = dataclasses.asdict(dataclasses.replace(sized, machine=None, metrics=None))
    return {n: v for n, v in row.items() if v is not None} | {"metrics": sized.metrics.to_dict("records")}


def open_sizing(folder: Path | str) -> tuple[dict, pd.DataFrame]:
    """The result (as in result.json, SI) and the path of every start.

    Raises:
        ResultFileError: the folder holds no sizing result.
    """
    folder = Path(folder)
    for name in (RESULT, PATH):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not the folder of a sizing: {name} is missing")
    return json.loads((folder / RESULT).read_text(encoding="utf-8")), pd.read_parquet(folder / PATH)
