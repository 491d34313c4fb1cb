"""Which parameters matter where: elasticities, Sobol indices and Morris's effects at every operating point, on disk."""


import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.config.writer import dump_config
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.design.batch.cycle import Status
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, designs_at, full_factorial
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.table import gradient, metrics_of, parameters_of
from edhas_jax.design.sensitivity.sobol_morris import morris, sobol
from edhas_jax.design.task_reader import TaskReader
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run import Simulation

SECTIONS = ("points", "metrics", "local", "ranges", "samples", "trajectories", "seed")
DEFAULT_METRICS = ("mean_flow", "mean_electrical_power", "overall_efficiency")


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """What is to be found out: which parameters act on which metrics, at which operating points.

    `local` are the parameters of the elasticities; `ranges` those of the global analysis, `samples` of Sobol's and
    `trajectories` of Morris's method (0: left out, as without ranges). `points` span a grid of operating points.
    """

    machine: Rig
    points: tuple[Axis, ...]
    metrics: tuple[str, ...]
    local: tuple[str, ...]
    ranges: tuple[Axis, ...]
    samples: int = 256
    trajectories: int = 20
    seed: int = 0
    settings: BatchSettings = BatchSettings()
    name: str = ""
    text: str = ""

    def operating_points(self) -> dict[str, np.ndarray]:
        """The columns (SI) of the operating points; none: the machine as it stands."""
        return full_factorial(self.points) if self.points else {}


def load_sensitivity(path: Path | str) -> Sensitivity:
    """The analysis in a YAML file.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    reader = TaskReader(path, SECTIONS, "ranges", optional=True)
    points = reader.operating_points("points")
    known = metrics_of(reader.machine) if reader.machine is not None and not reader.problems else []
    metrics = reader.list_section("metrics")
    for i, name in enumerate(metrics):
        if known and name not in known:
            reader.add(("metrics", i), f"no metric `{name}`; {suggest(str(name), known)}")
    local = []
    for i, name in enumerate(reader.list_section("local")):
        try:
            local += [resolve_parameter(reader.machine, str(name))[1]] if reader.machine is not None else []
        except ParameterError as error:
            reader.add(("local", i), str(error))
    samples = reader.read_integer(("samples",), reader.data.get("samples", "256"), 0, 2**16)
    if samples & (samples - 1):
        reader.add(("samples",), f"a power of two belongs here (Sobol's sequence needs it), not {samples}")
    trajectories = reader.read_integer(("trajectories",), reader.data.get("trajectories", "20"), 0, 10_000)
    seed = reader.read_integer(("seed",), reader.data.get("seed", "0"), 0, 2**32 - 1)
    both = {axis.name for axis in points} & {axis.name for axis in reader.axes}
    for name in sorted(both):
        reader.add(("ranges", name), "is held at the operating points; leave it out here or there")
    reader.finish()
    axes = reader.axes
    default = tuple(n for n in DEFAULT_METRICS if n in known) or tuple(known[:3])
    return Sensitivity(
        reader.machine, points, tuple(metrics) or default,
        tuple(dict.fromkeys(local)) or tuple(parameters_of(reader.machine)),
        axes, samples if axes else 0, trajectories if axes else 0, seed, reader.settings, reader.name, reader.text,
    )  # fmt: skip


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
                table = designs_at(task.ranges, shares)
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
        ResultFileError: the folder has none.
    """
    folder = Path(folder)
    for name in ("points.parquet", "local.parquet"):
        if not (folder / name).is_file():
            raise ResultFileError(f"{folder}: not the folder of a sensitivity analysis: {name} is missing")
    tables = {n: pd.read_parquet(folder / f"{n}.parquet") for n in TABLES if (folder / f"{n}.parquet").is_file()}
    return Findings(pd.read_parquet(folder / "points.parquet"), **tables)
