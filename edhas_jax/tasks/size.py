"""Size: the dimensions that make a machine best within its limits."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_config import Config, as_config
from edhas_jax.config.run_folder import write_json
from edhas_jax.config.writer import dump_config
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned, jsonable
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity, from_si
from edhas_jax.design.sizing.config import SizingTask, load_sizing
from edhas_jax.design.sizing.figures import draw_front, draw_path
from edhas_jax.design.sizing.size import SizedMachine, SizingResult
from edhas_jax.design.sizing.size import size as solve
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run_settings import Simulation
from edhas_jax.tasks.python_values import axes, bounds, tolerances
from edhas_jax.tasks.result import Result, save_figure, with_methods


@dataclasses.dataclass(frozen=True, repr=False)
class SizeResult(Result, SizingResult):
    """The sized machines of a task; see `SizingResult` for its numbers.

    Attributes:
        task: what was asked for.
    """

    task: SizingTask = None
    files = ("sized*.yaml", "start.yaml", "sizing.yaml", "path.parquet", "result.json", "path.png", "front.png")

    @property
    def best(self) -> SizedMachine:
        """The sized machine, or the first one of a Pareto front; its `machine` can be simulated."""
        return self.machines[0]

    def summary(self) -> Summary:
        """See `Result.summary`."""
        task = self.task
        names = self._names()
        title = (f"{task.name or 'sizing'}: {len(task.variables)} dimensions, {len(self.start.metrics)} cases; "
                 f"{self.machine_seconds:,.0f} machine-seconds in {self.seconds:.0f} s; "
                 f"{100 * self.share_near_best:.0f} % of the starts end within 1 % of the best")  # fmt: skip
        limits = []
        for name, sized in zip(names[1:], self.machines, strict=True):
            reached = "; ".join(sized.active) or "no bound or limit (interior optimum)"
            limits.append(f"{name}: limited by {reached}. {sized.convergence}")
            limits += [Toned(f"{name}: {warning}", Tone.CAUTION) for warning in sized.warnings]
        return Summary(title, (self._dimensions(names), self._metrics(names), *limits))

    def _names(self) -> list[str]:
        count = len(self.machines)
        return ["start", *([f"design {k + 1}" for k in range(count)] if self.task.front else ["sized"])]

    def _dimensions(self, names: list[str]) -> SummaryTable:
        rows, records = [], []
        for axis in self.task.variables:
            start = float(get_parameter(self.task.machine, axis.name))
            values = [start, *(s.design[axis.name] for s in self.machines)]
            rows.append((axis.name, *(format_quantity(v, axis.unit) for v in values)))
            records.append({"dimension": axis.name, "unit": axis.unit, **dict(zip(names, values, strict=True))})
        return SummaryTable.of("dimensions", ("dimension", *names), rows, records, "dimensions")

    def _metrics(self, names: list[str]) -> SummaryTable:
        rows, records = [], []
        declared = self.task.machine.metrics
        for metric in (c for c in self.start.metrics.columns if c in declared):
            si_unit, display_unit = declared[metric].unit, declared[metric].display_unit
            cells, record = [], {"metric": metric, "unit": si_unit}
            for name, sized in zip(names, (self.start, *self.machines), strict=True):
                ends = [float(f(sized.metrics[metric])) for f in (min, max)]
                low, high = (from_si(end, si_unit, display_unit) for end in ends)
                span = f"{low:.4g} … {high:.4g}" if high > low * 1.0001 else f"{high:.4g}"
                cells.append(f"{span} {display_unit}")
                record[name] = ends
            rows.append((metric, *cells))
            records.append(record)
        title = "metrics, lowest … highest of the cases"
        return SummaryTable.of("metrics", ("metric", *names), rows, records, title)

    def plot(self):
        """Plot the objective and every dimension along the search from each start, as a matplotlib figure."""
        return draw_path(self.task, self)

    def plot_front(self):
        """Plot the Pareto front, as a matplotlib figure.

        Raises:
            ValueError: the task asked for a single design.
        """
        if not self.task.front:
            raise ValueError("this sizing has no front; ask for one with front=10, say, and two metrics")
        return draw_front(self.task, self)

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`; the machines as configurations that `edhas simulate` runs."""
        simulation, count = Simulation(step=self.task.settings.step), len(self.machines)
        names = ["sized.yaml"] if count == 1 else [f"sized_{k + 1}.yaml" for k in range(count)]
        machines = [sized.machine for sized in self.machines]
        for name, machine in zip((*names, "start.yaml"), (*machines, self.task.machine), strict=True):
            (folder / name).write_text(dump_config(machine, simulation), encoding="utf-8")
        (folder / "sizing.yaml").write_text(self.task.text, encoding="utf-8")
        self.path.to_parquet(folder / "path.parquet")
        write_json(folder / "result.json", jsonable({
            "start": _numbers(self.start),
            "machines": [_numbers(s) | {"config": name} for name, s in zip(names, self.machines, strict=True)],
            "share of starts within 1 %": self.share_near_best,
            "machine_seconds": self.machine_seconds, "seconds": self.seconds,
        }))  # fmt: skip
        save_figure(self.plot(), folder / "path.png")
        if self.task.front:
            save_figure(self.plot_front(), folder / "front.png")
        return ()


def _numbers(sized: SizedMachine) -> dict[str, Any]:
    """A sized machine as plain data."""
    row = dataclasses.asdict(dataclasses.replace(sized, machine=None, metrics=None))
    return {n: v for n, v in row.items() if v is not None} | {"metrics": sized.metrics.to_dict("records")}


def size(
    source: Rig | Config | SizingTask | Mapping[str, Any] | Path | str,
    free: Mapping[str, Any] | None = None,
    maximise: Sequence[str] | Mapping[str, float] = (),
    minimise: Sequence[str] | Mapping[str, float] = (),
    constraints: Mapping[str, Any] | None = None,
    points: Mapping[str, Any] | None = None,
    robust: Mapping[str, Any] | None = None,
    front: int = 0,
    starts: int = 32,
    iterations: int = 60,
    seed: int = 0,
    trust: Trust = (),
    on_progress: Callable[[str, float], None] | None = None,
) -> SizeResult:
    """Find the dimensions that make a machine best within its limits.

        edhas_jax.size(machine, free={"piston_diameter": ("10 mm", "20 mm")}, maximise=["overall_efficiency"],
                       constraints={"rms_current": {"max": "4 A"}}, points={"frequency": [10, 20]})

    Args:
        source: a machine, a configuration or its file; without `free` a task or the file of one.
        free: by dimension its range (from, to) or (from, to, "log"); numbers in SI, texts with unit.
        maximise: metrics, or metrics with weights.
        minimise: likewise.
        constraints: by metric {"min": …, "max": …}.
        points: by parameter a list of values: all combinations are the operating points.
        robust: {"judge": "expected" or "worst_case", "tolerances": {parameter: {"plus_minus": "3 um"}}}.
        front: number of designs along a Pareto front of the two metrics; 0 for a single design.
        starts: number of starts.
        iterations: of the descent from each start.
        seed: of the starts.
        trust: Python files of your own that may run if a configuration names them.
        on_progress: called with the name of a stage and the share done.

    Raises:
        ConfigError: the task is wrong (every problem, one line each), or has no solution (`SizingError`).
    """
    task = source
    if free is not None:
        machine = as_config(source, trust).machine
        task = load_sizing({
            "machine": machine, "free": {n: _without_count(s) for n, s in axes(machine, free).items()},
            "objective": {"maximise": _weights(maximise), "minimise": _weights(minimise)},
            "constraints": bounds(machine, constraints), "points": axes(machine, points),
            "robust": tolerances(machine, robust),
            "front": str(front), "starts": str(starts), "iterations": str(iterations), "seed": str(seed),
        }, trust)  # fmt: skip
    elif not isinstance(source, SizingTask):
        task = load_sizing(source, trust)
    return with_methods(SizeResult, solve(task, on_progress), task=task)


def _weights(metrics: Sequence[str] | Mapping[str, float]) -> dict[str, str]:
    metrics = (metrics,) if isinstance(metrics, str) else metrics
    return {n: str(w) for n, w in (metrics.items() if isinstance(metrics, Mapping) else ((n, 1) for n in metrics))}


def _without_count(spec: Any) -> Any:
    return {k: v for k, v in spec.items() if k != "count"} if isinstance(spec, Mapping) else spec
