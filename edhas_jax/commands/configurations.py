"""The commands on a configuration: run a machine, sweep it, draw a sweep, analyse, size and export it."""

import dataclasses
import os
import time
from collections import Counter
from pathlib import Path

from edhas_jax.commands.command_line import NOT_VALID
from edhas_jax.commands.console import finish, quoted, say
from edhas_jax.commands.options import output_folder, own_code, require_own_code
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.config.machine_config import read_config
from edhas_jax.config.result_files import ResultFileError, require_new
from edhas_jax.core.summary import Summary, SummaryTable


def simulate(options) -> int:
    """Simulate a machine, write a run folder, print status, metrics and energy ledger.

    Returns:
        The exit status: 0, or 3 if the result is not valid.
    """
    from edhas_jax.tasks.simulate import simulate

    config = read_config(options.config, options.overrides, own_code(options))
    require_own_code(options, config.machine)
    folder = output_folder(options, "runs", options.config.stem)
    require_new(folder, options.overwrite)
    began = time.perf_counter()
    with WorkProgress(options, "compiling and simulating") as progress:
        result = simulate(config, on_progress=lambda share: progress("simulating", share))
    seconds = time.perf_counter() - began
    result.save(folder, options.overwrite, figure=not options.no_figure)
    summary = result.summary(config.name or options.config.stem, f"{seconds:.1f} s with compilation")
    finish(options, summary, folder, f"parameters {quoted(options.config)}")
    return 0 if result.valid else NOT_VALID


def sweep(options) -> None:
    """Simulate the designs of a sweep that have no result yet; print how many ended with which status.

    Raises:
        KeyboardInterrupt: the user has interrupted it; the text says what is finished.
    """
    from edhas_jax.design.sweep.config import load_sweep
    from edhas_jax.design.sweep.dask_cluster import dask_executor
    from edhas_jax.design.sweep.run import stream_sweep, sweep_parts
    from edhas_jax.design.sweep.table import summary_of_parts

    sweep = load_sweep(options.config, own_code(options))
    require_own_code(options, sweep.machine)
    folder = options.out or Path("runs") / options.config.stem
    name, began = sweep.name or options.config.stem, time.perf_counter()
    with WorkProgress(options, f"{name}: compiling") as work:
        progress = _SweepProgress(work, name)
        try:
            with dask_executor(options.cluster) as executor:
                stream_sweep(sweep, folder, executor, progress.report, lambda remark: say(options, remark))
        except KeyboardInterrupt:
            finished = f"{progress.first_and_last[1]:,} of {len(sweep):,} designs are finished and saved in {folder}"
            raise KeyboardInterrupt(f"edhas: interrupted; {finished}; the same command resumes the sweep") from None
    computed = len(sweep) - progress.first_and_last[0]
    took = f"{time.perf_counter() - began:.1f} s"
    effort = f"{computed:,} computed in {took}" if computed else "all of them computed before"
    summary = summary_of_parts(sweep_parts(folder))
    summary = dataclasses.replace(summary, title=f"{name}: {len(sweep):,} designs, {effort}")
    finish(options, summary, folder, f"plot sweep {quoted(folder)}")


class _SweepProgress:
    """Designs done, designs per second and time left."""

    def __init__(self, work: WorkProgress, name: str):
        self._work, self._name, self._reports = work, name, []

    @property
    def first_and_last(self) -> tuple[int, int]:
        """The number of finished designs at the first report and at the last one."""
        return (self._reports[0][1], self._reports[-1][1]) if self._reports else (0, 0)

    def report(self, done: int, total: int) -> None:
        """Update the display; `done` of `total` designs are finished."""
        self._reports.append((time.perf_counter(), done))
        status = f"{done:,} of {total:,} designs"
        if len(self._reports) > 2:  # the first chunk includes the compile time
            (began, first), (now, _) = self._reports[1], self._reports[-1]
            rate = (done - first) / (now - began)
            status += f", {rate:.3g} designs/s, {_duration((total - done) / rate)} left"
        elif len(self._reports) == 1 and done < total:
            status += ", compiling"
        self._work(f"{self._name}: {status}", done / total)


def _duration(seconds: float) -> str:
    """A duration [s] as text, such as "3 min 05 s"."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s" if minutes else f"{seconds} s"


def plot_sweep(options) -> None:
    """Draw the pictures of a sweep's result.

    Raises:
        ResultFileError: the result does not hold what a picture needs, or a picture cannot be written.
    """
    from edhas_jax.design.sweep.design_selection import FigureError
    from edhas_jax.design.sweep.figures import KINDS, draw_sweep, metrics_of_figures
    from edhas_jax.design.sweep.run import open_sweep
    from edhas_jax.tasks.result import save_figure

    # a table of millions of designs is read only as far as it is drawn
    result = open_sweep(options.result, lambda names: metrics_of_figures(names, options.metric, options.pareto))
    kinds = KINDS if options.kind == "all" else (options.kind,)
    for kind in kinds:
        path = options.out or options.result / f"{kind}.png"
        if options.out and len(kinds) > 1:
            path = options.out.with_name(f"{options.out.stem}_{kind}{options.out.suffix}")
        try:
            figure = draw_sweep(result, kind, options.metric, options.x, options.y, options.slices, options.average,
                                options.pareto)  # fmt: skip
        except FigureError as error:
            if options.kind != "all" or not error.missing:
                raise ResultFileError(f"{options.result}: {error}") from None
            say(options, f"no picture {kind}: {error}")
            continue
        save_figure(figure, path)
        say(options, f"written: {path}")


def sensitivity(options) -> None:
    """Run a sensitivity analysis, write tables and pictures, print the largest elasticities."""
    from edhas_jax.design.sensitivity.config import load_sensitivity
    from edhas_jax.tasks.sensitivity import SensitivityResult, sensitivity

    _design_task(options, load_sensitivity, sensitivity, SensitivityResult, "machine.yaml")


def size(options) -> None:
    """Size a machine, write configurations, search path and pictures, print dimensions, metrics and active limits."""
    from edhas_jax.design.sizing.config import load_sizing
    from edhas_jax.tasks.size import SizeResult, size

    _design_task(options, load_sizing, size, SizeResult, "sized*.yaml")


def _design_task(options, load, solve, kind, machine: str) -> None:
    """Read a task, solve it, save its result of a `kind`; the next command simulates a file named like `machine`."""
    task = load(options.config, own_code(options))
    require_own_code(options, task.machine)
    folder = output_folder(options, "runs", options.config.stem)
    kind.reserve(folder, options.overwrite)
    with WorkProgress(options, "compiling") as progress:
        result = solve(task, on_progress=progress)
    result.save(folder, options.overwrite)
    finish(options, result.summary(), folder, f"simulate {quoted(min(folder.glob(machine)))}")


def export(options) -> None:
    """Write a configuration as an FMU and print its inputs, size and platforms."""
    from edhas_jax.export.fmu import export_fmu

    compilers = [] if options.sources_only else options.compilers or [os.environ.get("CC") or "cc"]
    config = read_config(options.config, options.overrides, own_code(options))
    require_own_code(options, config.machine)
    path = options.out or Path(f"{options.config.stem}.fmu")
    with WorkProgress(options) as progress:
        unit = export_fmu(config, path, options.inputs, compilers, options.overwrite, progress)
    variables = unit.program.values
    inputs = [v for v in variables if v.causality.value == "input"]
    rows = [(v.name, v.unit, f"{v.start:g}", v.doc) for v in inputs]
    records = [{"input": v.name, "unit": v.unit, "start": v.start, "meaning": v.doc} for v in inputs]
    table = SummaryTable.of("inputs", ("input", "unit", "start", "meaning"), rows, records, "inputs")
    count = Counter(v.causality.value for v in variables)
    platforms = " and ".join(unit.platforms)
    binary = f"binary for {platforms}" if platforms else "no binary; compile sources/fmu_unit.c on the target"
    effects = ", ".join(e.id for e in config.machine.effects) or "none"
    sentence = (
        f"{count['input']} inputs, {count['parameter']} parameters, {len(unit.program.outputs)} outputs; "
        f"{binary} and C sources; FMI 2.0 co-simulation, {unit.path.stat().st_size / 1024:.0f} KiB"
    )
    title = f"{config.name or options.config.stem}: {config.machine.name}, effects: {effects}"
    finish(options, Summary(title, (*([table] if rows else []), sentence)), written=str(unit.path))
