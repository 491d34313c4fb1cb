"""Sweep: the metrics of many designs of a machine, each in its periodic state."""

import contextlib
import datetime
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.document import Entry, problem_lines
from edhas_jax.config.machine_config import Config, ConfigError, as_config
from edhas_jax.core.trusted_code import Trust
from edhas_jax.design.batch.batch import BatchSettings, engine_of_designs, plan_chunks, run_designs, settings_of_batch
from edhas_jax.design.batch.experiment_design import DesignError, full_factorial, latin_hypercube
from edhas_jax.design.sweep.config import Sweep, load_sweep
from edhas_jax.design.sweep.dask_cluster import dask_executor
from edhas_jax.design.sweep.dataset import SweepData, to_dataset
from edhas_jax.design.sweep.folder import sweep_description
from edhas_jax.design.sweep.identity import machine_text, versions
from edhas_jax.design.sweep.run import open_sweep, stream_sweep
from edhas_jax.design.sweep.table import sweep_table, to_result
from edhas_jax.design.task_file import read_axes
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.tasks.python_values import axes as axes_of


def sweep(
    source: Rig | Config | Sweep | Mapping[str, Any] | Path | str,
    *,
    samples: int | None = None,
    seed: int = 0,
    settings: BatchSettings | None = None,
    folder: Path | str | None = None,
    cluster: str | None = None,
    trust: Trust = (),
    on_progress: Callable[[int, int], None] | None = None,
    **parameters: Any,
) -> SweepData:
    """Run many designs of a machine, each to its periodic state.

        edhas_jax.sweep(machine, piston_clearance=("5 um", "40 um", 20), frequency=[5, 10, 20])

    Args:
        source: a machine, a configuration or its file; without parameters a sweep or the file of one.
        samples: number of designs of a Latin hypercube over the ranges; None: every combination of the values.
        seed: of these samples.
        settings: step, tolerance and precision; None: those of the configuration.
        folder: where the sweep is kept while it runs, so that the same call resumes it; None: in memory alone.
        cluster: "local:4" for four processes on this machine, or the address of a Dask scheduler; None: this process.
        trust: Python files of your own that may run if a configuration names them.
        on_progress: called with the numbers of finished and of all designs.
        **parameters: by name a tuple (from, to, count), (from, to, count, "log") or, with `samples`, (from, to); a
            list of values; or one value, which all designs have. Numbers are in SI, texts have a unit.

    Returns:
        An xarray Dataset in SI with units, a dimension per parameter of a grid; it draws and saves itself.

    Raises:
        ConfigError: a parameter, a range or the configuration is wrong; every problem, one line each.
        BatchError: the machine is not driven by a sine on a bench.
        SweepError: the folder holds something else or cannot be written, or the workers failed.
        ClusterError: the cluster cannot be reached or used.
    """
    task = describe_sweep(source, samples, seed, settings, trust, parameters)
    if folder is not None or cluster is not None:
        with contextlib.ExitStack() as stack:
            kept = folder or stack.enter_context(tempfile.TemporaryDirectory(prefix="edhas_sweep_"))
            stream_sweep(task, kept, stack.enter_context(dask_executor(cluster)), on_progress)
            return to_dataset(open_sweep(kept))
    metrics = run_designs(task.machine, task.designs, task.settings, on_progress)
    on_gpu = any(chunk.many_lanes for chunk in plan_chunks(task.machine, task.designs, task.settings))
    engine = engine_of_designs(task.machine, task.designs, task.settings.precision, on_gpu)
    now = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
    made = {"name": task.name, "machine": machine_text(task), "date": now, "sweep": sweep_description(task)}
    return to_dataset(to_result(sweep_table(task.machine, task.designs, metrics), made | versions(engine)))


def describe_sweep(
    source, samples: int | None, seed: int, settings: BatchSettings | None, trust: Trust,
    parameters: Mapping[str, Any],
) -> Sweep:  # fmt: skip
    """The sweep that `sweep` runs; arguments as there.

    Raises:
        ConfigError: as `sweep`.
    """
    if isinstance(source, Sweep):
        return source
    if not parameters:
        if isinstance(source, str | Path):
            return load_sweep(source, trust)
        raise ConfigError("sweep: at least one parameter belongs here, such as piston_clearance=('5 um', '40 um', 20)")
    config = as_config(source, trust)
    if settings is None:
        settings = BatchSettings(**settings_of_batch(config.machine, config.simulation))
    specs = axes_of(config.machine, parameters)
    fixed = {n: parameters[n] for n, spec in specs.items() if isinstance(spec, str)}
    machine = set_parameters(config.machine, fixed)
    kind = "grid" if samples is None else "latin_hypercube"
    varied = Entry({n: s for n, s in specs.items() if n not in fixed})
    axes = read_axes(varied, machine, kind)
    if varied.problems:
        raise ConfigError(problem_lines(f"sweep: {'.'.join(map(str, key))}: {what}" for key, what in varied.problems))
    try:
        designs = full_factorial(axes) if samples is None else latin_hypercube(axes, samples, seed)
    except DesignError as error:
        raise ConfigError(f"sweep: {error}") from None
    return Sweep(machine, designs, settings, kind, axes, None if samples is None else seed, config.name)
