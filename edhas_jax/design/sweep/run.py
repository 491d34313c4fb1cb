"""Run a sweep chunk by chunk, resume an interrupted one, and read its result."""

import concurrent.futures
import contextlib
import dataclasses
import functools
import itertools
import os
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from edhas_jax.config.machine_config import build_config
from edhas_jax.config.yaml_with_lines import parse_yaml
from edhas_jax.core.trusted_code import TrustedCode
from edhas_jax.design.batch.batch import BatchSettings, Chunk, engine_of_designs, plan_chunks, run_chunk
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.folder import (
    DESIGNS_FILE,
    ChunkResult,
    SweepError,
    SweepFolder,
    each_chunk_file,
    open_listed_file,
    read_manifest,
)
from edhas_jax.design.sweep.identity import device, machine_text, user_code, versions
from edhas_jax.design.sweep.table import TABLE_FILE, TEXT_COLUMNS, SweepResult, to_result, with_results
from edhas_jax.machine.interface.metrics import in_order
from edhas_jax.machine.rigs import Rig

MOST_PENDING = 256  # chunks that are handed to workers at a time


@dataclasses.dataclass(frozen=True)
class ChunkJob:
    """A chunk to compute, with all that a worker process needs for it.

    Attributes:
        number: of the chunk in the sweep.
        machine: the machine as configuration text, so that every process builds the same.
        code: the user's code that the machine needs, with the content that has run where the sweep was read.
        values: by parameter the values (SI) of its designs, shape (designs,).
        steps_per_cycle: integration steps per cycle of the set point.
        settings: settings of the batch.
        many_lanes: as of the `Chunk`.
    """

    number: int
    machine: str
    code: TrustedCode
    values: Mapping[str, np.ndarray]
    steps_per_cycle: int
    settings: BatchSettings
    many_lanes: bool = False


def compute_chunk(job: ChunkJob) -> ChunkResult:
    """Run all designs of one chunk in this process."""
    rows = np.arange(len(next(iter(job.values.values()))))
    machine = _build_machine(job.machine, job.code)
    metrics = run_chunk(machine, job.values, Chunk(rows, job.steps_per_cycle, job.many_lanes), job.settings)
    engine = engine_of_designs(machine, job.values, job.settings.precision, job.many_lanes)
    return ChunkResult(job.number, metrics, versions(engine), device(engine))


@functools.lru_cache(maxsize=8)
def _build_machine(text: str, code: TrustedCode) -> Rig:
    return build_config(parse_yaml(text)[0], trust=code).machine


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
    stream_sweep(sweep, folder, executor, on_progress, on_remark)
    return open_sweep(folder).frame


def stream_sweep(
    sweep: Sweep,
    folder: Path | str,
    executor: concurrent.futures.Executor | None = None,
    on_progress: Callable[[int, int], None] | None = None,
    on_remark: Callable[[str], None] = warnings.warn,
) -> None:
    """Run a sweep as `run_sweep` does, without holding the results of all designs in memory."""
    chunks = plan_chunks(sweep.machine, sweep.designs, sweep.settings)
    with SweepFolder(sweep, folder, chunks) as store:
        finished = set() if store.is_finished else store.finished()
        for remark in store.remarks:
            on_remark(remark)
        done = len(sweep) if store.is_finished else sum(len(chunks[n].rows) for n in finished)
        if on_progress is not None:
            on_progress(done, len(sweep))
        if store.is_finished:
            return
        store.check_space(len(sweep) - done)
        text, code = machine_text(sweep), user_code(sweep.machine)
        jobs = (
            ChunkJob(n, text, code, {k: v[c.rows] for k, v in sweep.designs.items()}, c.steps_per_cycle, sweep.settings,
                     c.many_lanes)  # fmt: skip
            for n, c in enumerate(chunks)
            if n not in finished
        )
        ours = store.identity["versions"]
        for result in map(compute_chunk, jobs) if executor is None else _compute_in(executor, jobs, ours):
            store.write(result)
            done += len(chunks[result.number].rows)
            if on_progress is not None:
                on_progress(done, len(sweep))
        store.complete()


def _compute_in(
    executor: concurrent.futures.Executor, jobs: Iterator[ChunkJob], ours: Mapping[str, str]
) -> Iterator[ChunkResult]:
    """The results of an executor's workers as they arrive; `MOST_PENDING` jobs are handed out at a time."""
    waiting: set[concurrent.futures.Future] = set()
    try:
        while True:
            for job in itertools.islice(jobs, MOST_PENDING - len(waiting)):
                waiting.add(executor.submit(compute_chunk, job))
            if not waiting:
                return
            done, _ = concurrent.futures.wait(waiting, return_when=concurrent.futures.FIRST_COMPLETED)
            for future in done:
                waiting.remove(future)
                yield _checked(future, ours)
    finally:
        for future in waiting:
            future.cancel()


def _checked(future: concurrent.futures.Future, ours: Mapping[str, str]) -> ChunkResult:
    """The result of a worker that runs the same versions as this process, `ours`."""
    try:
        result = future.result()
    except (Exception, concurrent.futures.CancelledError) as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        lost = isinstance(error, concurrent.futures.CancelledError)
        what = "the workers or their scheduler were lost" if lost else f"a worker failed: {what}"
        raise SweepError(f"{what}. Finished chunks are kept; the same command resumes the sweep") from error
    if result.versions != ours:
        theirs = ", ".join(f"{k} {v}" for k, v in result.versions.items() if ours[k] != v)
        raise SweepError(f"a worker runs other versions ({theirs}); install the versions of this machine")
    return result


def open_sweep(folder: Path | str, wanted: Callable[[Sequence[str]], Collection[str]] | None = None) -> SweepResult:
    """Read the result of a sweep; designs that have not been run yet have the status "not_run".

    Args:
        folder: the folder of the sweep.
        wanted: which of the metrics are to be in the table, from the names of all in the order in which they are
            shown; None: all. With it the table is only to be read, and has no reasons.

    Returns:
        The table of all designs with units and meanings.

    Raises:
        SweepError: not the folder of a sweep, or its table is damaged.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    finished = _has_table(folder, manifest)
    with _opened(folder, manifest, TABLE_FILE if finished else DESIGNS_FILE) as file:
        data = pq.ParquetFile(file, read_dictionary=TEXT_COLUMNS if finished else [])
        if finished:
            whole = data.schema_arrow
            if wanted is None:
                return to_result(data.read(), manifest)
            about = {f.name: f.metadata for f in whole if (f.metadata or {}).get(b"role") == b"metric"}
            left_out = {"reason", *about} - set(wanted(in_order(about, lambda n: int(about[n].get(b"rank", 0)))))
            return to_result(data.read([n for n in whole.names if n not in left_out]), manifest, whole)
        data = data.read()
    results: dict[str, np.ndarray] = {n: np.full(len(data), np.nan) for n in ("cycles", "residual", "status")}
    for _, _, chunk in each_chunk_file(folder):
        if chunk is not None and chunk.sweep == manifest["hash"]:
            rows = chunk.columns.pop("design")
            for name, column in chunk.columns.items():
                results.setdefault(name, np.full(len(data), np.nan))[rows] = column
    return to_result(with_results(data, results), manifest)


def sweep_parts(folder: Path | str) -> Iterator[SweepResult]:
    """As `open_sweep`, in parts of some designs each.

    Raises:
        SweepError: see `open_sweep`.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    if not _has_table(folder, manifest):
        yield open_sweep(folder)
        return
    with _opened(folder, manifest, TABLE_FILE) as file:
        data = pq.ParquetFile(file, read_dictionary=TEXT_COLUMNS)
        # `iter_batches` would read the whole file before the first part
        for number in range(data.num_row_groups):
            yield to_result(data.read_row_group(number), manifest, data.schema_arrow)


def _has_table(folder: Path, manifest: Mapping[str, Any]) -> bool:
    """Whether the sweep is finished; without its table it is read from its chunks."""
    return manifest["state"] == "finished" and os.path.lexists(folder / TABLE_FILE)


@contextlib.contextmanager
def _opened(folder: Path, manifest: dict[str, Any], name: str) -> Iterator[BinaryIO]:
    """A file of the folder; whatever is wrong with it is a `SweepError`."""
    try:
        file = open_listed_file(folder, manifest, name)
        if file is None:
            raise ValueError(f"{name} is damaged or was changed; the command that made the folder repairs it")
        with file:
            yield file
    except (OSError, ValueError, KeyError, pa.ArrowException) as error:
        if isinstance(error, SweepError):
            raise
        raise SweepError(f"{folder}: unreadable or half-written: {error}") from None
