"""Clusters: an executor whose workers are processes of this machine or of others, by Dask distributed."""

import contextlib
import logging
import re
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor

from edhas_jax.config.run_folder import ResultFileError
from edhas_jax.core.runtime import cores
from edhas_jax.design.sweep.chunk_task import versions

WAIT = 10.0  # s, for a scheduler to answer
FAILURES = 1000  # workers that may die with the same chunk before it is given up


class ClusterError(ResultFileError):
    """There is no cluster of this description."""


@contextlib.contextmanager
def executor(spec: str) -> Iterator[Executor]:
    """The executor of "local:4" (four worker processes here) or of a Dask scheduler, "tcp://host:8786".

    Raises:
        ClusterError: not such a text, Dask is not installed, nobody answers, or a worker has another version.
    """
    local = re.fullmatch(r"local:([1-9]\d{0,3})", spec)
    if not local and not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", spec):
        raise ClusterError(f"--cluster {spec}: write local:2 for processes here, or tcp://host:8786")
    try:
        import dask
        import distributed
    except ImportError:
        raise ClusterError(
            'a cluster needs Dask, which is not installed; install it with: pip install "edhas_jax[cluster]"'
        ) from None
    # what it has to say about a lost scheduler is a traceback; the client says it in a sentence
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({"distributed.scheduler.allowed-failures": FAILURES}))
        if local:
            with _workers_ignore_interrupts():
                address = stack.enter_context(
                    distributed.LocalCluster(
                        n_workers=int(local[1]), threads_per_worker=1, processes=True, dashboard_address=None,
                        silence_logs=50, env={"EDHAS_CORES": str(max(1, cores() // int(local[1])))},
                    )
                )  # fmt: skip
        else:
            address = spec
        try:
            client = stack.enter_context(distributed.Client(address, timeout=WAIT))
        except (OSError, TimeoutError, ValueError):
            raise ClusterError(f"no scheduler answers at {spec} within {WAIT:.0f} s; nothing was computed") from None
        _check_workers(client, spec)
        yield client.get_executor(pure=False)


@contextlib.contextmanager
def _workers_ignore_interrupts() -> Iterator[None]:
    """Ctrl-C reaches every process of a terminal; it is the client that ends its workers."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _check_workers(client, spec: str) -> None:
    try:
        client.wait_for_workers(1, timeout=6 * WAIT)
    except TimeoutError:
        raise ClusterError(f"the scheduler at {spec} has no workers; nothing was computed") from None
    try:
        found = client.run(versions)
    except Exception as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ClusterError(f"the workers at {spec} cannot load edhas_jax: {what}") from None
    for worker, theirs in found.items():
        if theirs != versions():
            told = ", ".join(f"{k} {v} instead of {versions()[k]}" for k, v in theirs.items() if versions()[k] != v)
            raise ClusterError(f"the worker {worker} has {told}; install the same version everywhere")
