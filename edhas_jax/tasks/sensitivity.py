"""Sensitivity: which parameters matter at which operating point."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_config import Config, ConfigError, as_config
from edhas_jax.config.writer import dump_config
from edhas_jax.config.yaml_with_lines import YamlError, parse_yaml, read_text_file
from edhas_jax.core.summary import Summary, SummaryTable
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.sensitivity.analysis import SensitivityResult as SensitivityTables
from edhas_jax.design.sensitivity.analysis import analyse_sensitivity
from edhas_jax.design.sensitivity.config import SensitivityTask, load_sensitivity
from edhas_jax.design.sensitivity.figures import draw_local, draw_morris, draw_sobol
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run_settings import Simulation
from edhas_jax.tasks.python_values import axes
from edhas_jax.tasks.result import Result, save_figure, with_methods

MAX_SHOWN_PARAMETERS = 4  # of each metric in the summary


@dataclasses.dataclass(frozen=True, repr=False)
class SensitivityResult(Result, SensitivityTables):
    """Elasticities, Sobol indices and Morris effects, as tables of pandas; see the analysis for their columns.

    Attributes:
        task: what was asked for.
    """

    task: SensitivityTask = None
    files = (
        "points.parquet", "local.parquet", "sobol.parquet", "morris.parquet", "sensitivity.yaml", "machine.yaml",
        "local.png", "sobol.png", "morris.png",
    )  # fmt: skip

    @property
    def units(self) -> dict[str, str]:
        """The SI units of the columns of `points`."""
        return {n: resolve_parameter(self.task.machine, n)[0].unit for n in self.points.columns}

    def summary(self) -> Summary:
        """See `Result.summary`."""
        task, units = self.task, self.units
        rows, records = [], []
        for metric in task.metrics:
            local = self.local[self.local["metric"] == metric].dropna(subset=["elasticity"])
            size = local["elasticity"].abs()
            for k in size.loc[size.groupby(local["parameter"]).idxmax()].nlargest(MAX_SHOWN_PARAMETERS).index:
                row = local.loc[k]
                point = ", ".join(f"{n} {format_quantity(row[n], unit)}" for n, unit in units.items())
                rows.append((metric, row["parameter"], f"{row['elasticity']:+.2f}", point or "as configured"))
                at = {n: row[n] for n in units}
                records.append({"metric": metric, "parameter": row["parameter"], "elasticity": row["elasticity"], **at})
        notes = [
            f"{len(group)} of {len(self.local)}: {note} ({', '.join(group['metric'].unique())})"
            for note, group in self.local[self.local["note"] != ""].groupby("note")
        ]
        columns = "metric", "parameter", "value", "operating point"
        title = (f"{task.name or 'sensitivity'}: {len(self.points)} operating points, {len(task.local)} parameters, "
                 f"{len(task.metrics)} metrics")  # fmt: skip
        table = SummaryTable.of("largest_elasticities", columns, rows, records, "largest elasticities")
        return Summary(title, (table, *notes))

    def plot(self):
        """Plot the elasticities, one panel per metric, as a matplotlib figure."""
        return draw_local(self, self.units)

    def plot_sobol(self):
        """Plot the total-effect Sobol indices, as a matplotlib figure.

        Raises:
            ValueError: the analysis had no ranges.
        """
        if self.sobol is None:
            raise ValueError("this analysis has no Sobol indices; give `ranges`")
        return draw_sobol(self, self.units)

    def plot_morris(self):
        """Plot Morris effects, as a matplotlib figure.

        Raises:
            ValueError: the analysis had no ranges.
        """
        if self.morris is None:
            raise ValueError("this analysis has no Morris effects; give `ranges`")
        return draw_morris(self)

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        (folder / "sensitivity.yaml").write_text(self.task.text, encoding="utf-8")
        (folder / "machine.yaml").write_text(dump_config(self.task.machine, Simulation()), encoding="utf-8")
        self.points.to_parquet(folder / "points.parquet")
        for name, plot in (("local", self.plot), ("sobol", self.plot_sobol), ("morris", self.plot_morris)):
            if getattr(self, name) is not None:
                getattr(self, name).to_parquet(folder / f"{name}.parquet")
                save_figure(plot(), folder / f"{name}.png")
        return ()


def sensitivity(
    source: Rig | Config | SensitivityTask | Mapping[str, Any] | Path | str,
    metrics: Sequence[str] | None = None,
    parameters: Sequence[str] | None = None,
    points: Mapping[str, Any] | None = None,
    ranges: Mapping[str, Any] | None = None,
    samples: int = 256,
    trajectories: int = 20,
    seed: int = 0,
    trust: Trust = (),
    on_progress: Callable[[str, float], None] | None = None,
) -> SensitivityResult:
    """Which parameters matter where: elasticities, and with `ranges` Sobol indices and Morris effects.

        edhas_jax.sensitivity(machine, ["mean_flow"], points={"frequency": [10, 30]})

    Args:
        source: a machine or a configuration; also a task or the file of one, and then nothing else.
        metrics: the outputs; None: the three leading ones of the machine, such as flow, power and efficiency.
        parameters: whose elasticities are wanted; None: all that act in the periodic state.
        points: by parameter a list of values: all combinations are the operating points.
        ranges: by parameter (from, to), for the global analysis; numbers in SI, texts with unit.
        samples: rows of Sobol's method, a power of two; 0 leaves it out.
        trajectories: of Morris's method; 0 leaves it out.
        seed: of the samples.
        trust: Python files of your own that may run if a configuration names them.
        on_progress: called with the name of a stage and the share done.

    Raises:
        ConfigError: the task is wrong (every problem, one line each), or too many designs fail for statistics.
    """
    if isinstance(source, SensitivityTask):
        task = source
    elif isinstance(source, str | Path) and metrics is parameters is points is ranges is None and _is_task(source):
        task = load_sensitivity(source, trust)
    else:
        machine = as_config(source, trust).machine
        given = {"machine": machine, "metrics": list(metrics or ()), "local": list(parameters or ()),
                 "samples": str(samples), "trajectories": str(trajectories), "seed": str(seed)}  # fmt: skip
        given |= {n: axes(machine, of) for n, of in (("points", points), ("ranges", ranges)) if of}
        task = load_sensitivity(given, trust)
    return with_methods(SensitivityResult, analyse_sensitivity(task, on_progress), task=task)


def _is_task(path: Path | str) -> bool:
    """Whether a file describes an analysis and not a machine: it names no rig of its own."""
    try:
        return "rig" not in parse_yaml(read_text_file(Path(path), ConfigError))[0]
    except YamlError:
        return True  # the reader of tasks says what is wrong
