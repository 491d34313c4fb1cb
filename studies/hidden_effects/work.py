"""Run the jobs of a study one after the other or in several processes, and say how far it is."""

import multiprocessing
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TypeVar

from edhas_jax.commands.interruption import STATUS_INTERRUPTED

Job = TypeVar("Job")
JOBS_PER_WORKER = 10  # jobs after which a worker process is replaced, because compiled programs accumulate


def run_all(function: Callable[[Job], str], jobs: Sequence[Job], workers: int, kept: Path) -> None:
    """Call a function for every job and print the sentences that it returns.

    Args:
        function: runs one job; a function of a module.
        jobs: the jobs.
        workers: number of processes, each with one core; with 1 the jobs run in this process.
        kept: the folder in which the function keeps what is finished.

    Raises:
        SystemExit: the user has interrupted the study, and was told where it goes on.
    """
    try:
        if workers == 1:
            _print_progress(map(function, jobs), len(jobs))
            return
        os.environ["EDHAS_CORES"] = "1"  # of each worker
        with multiprocessing.get_context("spawn").Pool(workers, maxtasksperchild=JOBS_PER_WORKER) as pool:
            _print_progress(pool.imap_unordered(function, jobs), len(jobs))
    except KeyboardInterrupt:
        print(f"stopped; {kept} has what is finished, the same command continues with the rest", file=sys.stderr)
        raise SystemExit(STATUS_INTERRUPTED) from None


def _print_progress(done: Iterator[str], count: int) -> None:
    start = time.perf_counter()
    for k, sentence in enumerate(done, start=1):
        elapsed = (time.perf_counter() - start) / 60.0
        left = elapsed / k * (count - k)
        print(f"[{k}/{count}, {elapsed:.1f} min, about {left:.0f} min left] {sentence}", flush=True)
