"""Run a sweep chunk by chunk, resume an interrupted one, and read its result."""

import concurrent.futures
import os
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.design.batch.batch import plan_chunks
from edhas_jax.design.sweep.chunk_files import read_chunk_files
from edhas_jax.design.sweep.chunk_job import ChunkJob, ChunkResult, compute_chunk
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.folder import DESIGNS_FILE, SweepFolder
from edhas_jax.design.sweep.identity import machine_text, user_code, versions
from edhas_jax.design.sweep.manifest import SweepError, read_listed_file, read_manifest
from edhas_jax.design.sweep.table import TABLE_FILE, SweepResult, to_result, with_results


def run_sweep(
    sweep: Sweep,
    folder: Path | str,
    executor: concurrent.futures.Executor | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    on_remark: Callable[[str], None] = warnings.warn,
) -> pd.DataFrame:
    """Run the missing designs of a sweep and return the table of all.

    Every finished chunk is written at once, so that an interrupted sweep is resumed by the same call.

    Args:
        sweep: the designs to run.
        folder: of the result; created if it is missing.
        executor: computes chunks in its workers, with the same results; by default they are computed here.
        on_progress: called with the numbers of finished and of all designs.
        on_remark: called with a sentence for each file that was damaged or incomplete and is made anew.

    Returns:
        A row per design in the order of the sweep, in SI; metrics are NaN where the status is not "ok".

    Raises:
        SweepError: the folder holds something else or cannot be written, or the workers failed.
    """
    chunks = plan_chunks(sweep.machine, sweep.designs, sweep.settings)
    with SweepFolder(sweep, folder, chunks) as store:
        finished = {} if store.table is not None else store.finished()
        for remark in store.remarks:
            on_remark(remark)
        if store.table is not None:
            if on_progress is not None:
                on_progress(len(sweep), len(sweep))
            return store.table
        done = sum(len(chunks[n].rows) for n in finished)
        if on_progress is not None:
            on_progress(done, len(sweep))
        store.check_space(len(sweep) - done)
        text, code = machine_text(sweep), user_code(sweep.machine)
        jobs = [
            ChunkJob(n, text, code, {k: v[c.rows] for k, v in sweep.designs.items()}, c.steps_per_cycle, sweep.settings,
                     c.many_lanes)  # fmt: skip
            for n, c in enumerate(chunks)
            if n not in finished
        ]
        for result in map(compute_chunk, jobs) if executor is None else _compute_in(executor, jobs):
            store.write(result)
            finished[result.number] = result.metrics
            done += len(chunks[result.number].rows)
            if on_progress is not None:
                on_progress(done, len(sweep))
        return store.complete(finished)


def _compute_in(executor: concurrent.futures.Executor, jobs: list[ChunkJob]) -> Iterator[ChunkResult]:
    """The results of an executor's workers as they arrive."""
    futures = [executor.submit(compute_chunk, job) for job in jobs]
    try:
        for future in concurrent.futures.as_completed(futures):
            try:
                result = future.result()
            except (Exception, concurrent.futures.CancelledError) as error:
                what = str(error).splitlines()[0] if str(error) else type(error).__name__
                lost = isinstance(error, concurrent.futures.CancelledError)
                what = "the workers or their scheduler were lost" if lost else f"a worker failed: {what}"
                raise SweepError(f"{what}. Finished chunks are kept; "
                                 "the same command resumes the sweep") from error  # fmt: skip
            ours = versions(jobs[0].many_lanes)
            if result.versions != ours:
                theirs = ", ".join(f"{k} {v}" for k, v in result.versions.items() if ours[k] != v)
                raise SweepError(f"a worker runs other versions ({theirs}); install the versions of this machine")
            yield result
    finally:
        for future in futures:
            future.cancel()


def open_sweep(folder: Path | str) -> SweepResult:
    """Read the result of a sweep; designs that have not been run yet have the status "not_run".

    Args:
        folder: the folder of the sweep.

    Returns:
        The table of all designs with units and meanings.

    Raises:
        SweepError: not the folder of a sweep, or its table is damaged.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    # without its table a finished sweep is read from its chunks
    finished = manifest["state"] == "finished" and os.path.lexists(folder / TABLE_FILE)
    name = TABLE_FILE if finished else DESIGNS_FILE
    try:
        content = read_listed_file(folder, manifest, name)
        if content is None:
            raise ValueError(f"{name} is damaged or was changed; the command that made the folder repairs it")
        data = pq.read_table(pa.BufferReader(content))
    except (OSError, ValueError, pa.ArrowException) as error:
        raise SweepError(f"{folder}: unreadable or half-written: {error}") from None
    if finished:
        return to_result(data, manifest)
    metrics: dict[str, np.ndarray] = {n: np.full(len(data), np.nan) for n in ("cycles", "residual", "status")}
    for file in read_chunk_files(folder).values():
        if file is not None and file.sweep == manifest["hash"]:
            rows = file.columns.pop("design")
            for name, column in file.columns.items():
                metrics.setdefault(name, np.full(len(data), np.nan))[rows] = column
    return to_result(with_results(data, metrics), manifest)
