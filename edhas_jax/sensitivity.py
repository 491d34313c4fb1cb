"""Which parameters matter where: elasticities, Sobol indices and Morris's effects at every operating point, on disk."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from edhas_jax.batch import run_designs
from edhas_jax.config import ConfigError
from edhas_jax.cycle import Status
from edhas_jax.dump import dump_config
from edhas_jax.gradient_plan import GradientSettings
from edhas_jax.gradient_table import gradient
from edhas_jax.run import Simulation
from edhas_jax.sensitivity_config import Sensitivity
from edhas_jax.sensitivity_global import at_shares, morris, sobol
from edhas_jax.store import StoreError

TABLES = ("local", "sobol", "morris")
STEPS_PER_CYCLE = 8192  # elasticities within 0.01, see docs/gradients.md


@dataclasses.dataclass(frozen=True)
class Findings:
    """What an analysis found: `local` as `Gradient.frame`, `sobol` and `morris` with a `point` column, or None.

    `points` has the operating points (SI), a row each; without columns it is the machine as it stands.
    """

    points: pd.DataFrame
    local: pd.DataFrame
    sobol: pd.DataFrame | None = None
    morris: pd.DataFrame | None = None


def analyse(task: Sensitivity, on_progress: Callable[[str, float], None] | None = None) -> Findings:
    """Run an analysis; `on_progress(what, share)` is called as it goes.

    Raises:
        ConfigError: so many designs fail that there are no statistics.
    """

    def report(what: str, share: float) -> None:
        if on_progress is not None:
            on_progress(what, share)

    columns = task.operating_points()
    points = pd.DataFrame(columns, index=range(len(next(iter(columns.values()))) if columns else 1))
    settings = GradientSettings(steps_per_cycle=STEPS_PER_CYCLE)
    local = gradient(task.machine, task.metrics, task.local, columns or None, settings,
                     on_cycle=lambda share: report("elasticities", share)).frame  # fmt: skip
    tables: dict[str, pd.DataFrame] = {}
    names = [axis.name for axis in task.ranges]
    for kind, method, size in (("sobol", sobol, task.samples), ("morris", morris, task.trajectories)):
        if not size:
            continue
        found = []
        for k, point in points.iterrows():

            def outputs(shares, point=point, k=k, kind=kind):
                table = at_shares(task.ranges, shares)
                table |= {n: np.full(len(shares), value) for n, value in point.items()}

                def on_chunk(done, total):
                    report(kind, (k + done / total) / len(points))

                got = run_designs(task.machine, table, task.settings, on_chunk)
                values = np.stack([got[m] for m in task.metrics], axis=1)
                return np.where((got["status"] == Status.OK)[:, None], values, np.nan)

            try:
                found.append(method(outputs, names, task.metrics, size, task.seed).assign(point=k))
            except ValueError as error:
                raise ConfigError(f"{task.name or 'sensitivity'}: at operating point {k + 1}: {error}") from None
        tables[kind] = pd.concat(found, ignore_index=True)
    return Findings(points, local, **tables)


def save_findings(task: Sensitivity, findings: Findings, folder: Path) -> None:
    """Write tables, configuration and the machine with every parameter into a folder, made if it is missing."""
    folder.mkdir(parents=True, exist_ok=True)
    findings.points.to_parquet(folder / "points.parquet")
    for name in TABLES:
        table = getattr(findings, name)
        if table is not None:
            table.to_parquet(folder / f"{name}.parquet")
    (folder / "sensitivity.yaml").write_text(task.text, encoding="utf-8")
    (folder / "machine.yaml").write_text(dump_config(task.machine, Simulation()), encoding="utf-8")


def open_findings(folder: Path | str) -> Findings:
    """Read the tables of an analysis back.

    Raises:
        StoreError: the folder has none.
    """
    folder = Path(folder)
    for name in ("points.parquet", "local.parquet"):
        if not (folder / name).is_file():
            raise StoreError(f"{folder}: not the folder of a sensitivity analysis: {name} is missing")
    tables = {n: pd.read_parquet(folder / f"{n}.parquet") for n in TABLES if (folder / f"{n}.parquet").is_file()}
    return Findings(pd.read_parquet(folder / "points.parquet"), **tables)
