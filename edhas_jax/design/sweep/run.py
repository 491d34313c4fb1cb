"""Sweeps: run the designs of one chunk by chunk, and go on where the last run was stopped."""

import concurrent.futures
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.config.machine_config import build_config
from edhas_jax.config.yaml_with_lines import parse_yaml
from edhas_jax.design.batch.batch import plan_chunks
from edhas_jax.design.sweep.chunk_task import Answer, Task, compute, versions
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.folder import (
    CHUNKS,
    DESIGNS,
    SweepError,
    SweepFolder,
    machine_text,
    read_chunk,
    read_manifest,
)
from edhas_jax.design.sweep.table import TABLE, SweepResult, result_of, table_of


def run_sweep(
    sweep: Sweep,
    folder: Path | str,
    executor: concurrent.futures.Executor | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> pd.DataFrame:
    """Run what is missing of a sweep in `folder` and return its table: SI, a row per design, in their order.

    Every chunk that is finished is on disk at once, so that a sweep that was stopped goes on from there. With an
    `executor` chunks are computed by its workers; the numbers are the same. `on_progress(done, total)` counts designs.

    Raises:
        SweepError: the folder holds something else, cannot be written, or the workers are of no use.
    """
    chunks = plan_chunks(sweep.machine, sweep.designs, sweep.settings)
    with SweepFolder(sweep, folder, chunks) as store:
        if store.table is not None:
            if on_progress is not None:
                on_progress(len(sweep), len(sweep))
            return store.table
        finished = store.finished()
        done = sum(len(chunks[n].rows) for n in finished)
        if on_progress is not None:
            on_progress(done, len(sweep))
        store.check_space(len(sweep) - done)
        text = machine_text(sweep)
        tasks = [
            Task(n, text, {k: v[c.rows] for k, v in sweep.designs.items()}, c.steps_per_cycle, sweep.settings)
            for n, c in enumerate(chunks)
            if n not in finished
        ]
        for answer in map(compute, tasks) if executor is None else _answers(executor, tasks):
            store.write(answer)
            finished[answer.number] = answer.metrics
            done += len(chunks[answer.number].rows)
            if on_progress is not None:
                on_progress(done, len(sweep))
        return store.complete(finished)


def _answers(executor: concurrent.futures.Executor, tasks: list[Task]) -> Iterator[Answer]:
    """The answers of an executor's workers as they arrive."""
    futures = [executor.submit(compute, task) for task in tasks]
    try:
        for future in concurrent.futures.as_completed(futures):
            try:
                answer = future.result()
            except (Exception, concurrent.futures.CancelledError) as error:
                what = str(error).splitlines()[0] if str(error) else type(error).__name__
                lost = isinstance(error, concurrent.futures.CancelledError)
                what = "the workers or their scheduler were lost" if lost else f"a worker failed: {what}"
                raise SweepError(f"{what}. What is finished is kept; "
                                 "the same command goes on from there") from error  # fmt: skip
            if answer.versions != versions():
                theirs = ", ".join(f"{k} {v}" for k, v in answer.versions.items() if versions()[k] != v)
                raise SweepError(f"a worker runs other versions ({theirs}); install the same as here")
            yield answer
    finally:
        for future in futures:
            future.cancel()


def open_sweep(folder: Path | str) -> SweepResult:
    """Read the result of a sweep; of an unfinished one, what is finished.

    Raises:
        SweepError: not the folder of a sweep, or its table is damaged.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    try:
        if (folder / TABLE).exists():
            return result_of(pq.read_table(folder / TABLE), manifest)
        data = pq.read_table(folder / DESIGNS)
    except (OSError, ValueError, pa.ArrowException) as error:
        raise SweepError(f"{folder}: unreadable or half-written: {error}") from None
    designs = {name: data[name].to_numpy() for name in data.column_names}
    metrics: dict[str, np.ndarray] = {n: np.full(len(data), np.nan) for n in ("cycles", "residual", "status")}
    for path in sorted((folder / CHUNKS).glob("*.parquet")):
        columns = read_chunk(path, manifest["hash"])
        if columns is not None:
            rows = columns.pop("design")
            for name, column in columns.items():
                metrics.setdefault(name, np.full(len(data), np.nan))[rows] = column
    machine = build_config(parse_yaml(manifest["machine"])[0]).machine
    return result_of(table_of(machine, designs, metrics), manifest)
