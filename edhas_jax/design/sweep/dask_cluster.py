"""Executor on a Dask cluster: worker processes of this machine or of other machines."""

import contextlib
import logging
import re
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor

from edhas_jax.config.result_files import ResultFileError
from edhas_jax.core.runtime import cores
from edhas_jax.design.sweep.identity import versions

SCHEDULER_TIMEOUT = 10.0  # s, for the connection
MAX_WORKERS_PER_CORE = 4
WORKER_TIMEOUT_FACTOR = 6  # times the above, for the first worker
LARGEST_CALL = "1GB"  # Dask warns of larger arguments of a call; those of a fit contain derivatives of all signals
MAX_WORKER_FAILURES = 1000  # workers that may die with the same chunk before the sweep fails


class ClusterError(ResultFileError):
    """A cluster cannot be reached or used."""


@contextlib.contextmanager
def dask_executor(spec: str | None, versions: Callable[[], dict[str, str]] = versions) -> Iterator[Executor | None]:
    """Connect to a cluster for the duration of a context.

    Args:
        spec: "local:4" for four worker processes on this machine, or the address of a Dask scheduler,
            "tcp://host:8786"; None: no cluster.
        versions: the versions that must be the same in all processes, from a function of a module.

    Yields:
        An executor that runs its calls on the workers; None without a cluster.

    Raises:
        ClusterError: the text is invalid, Dask is not installed, no scheduler answers, or a worker has other versions.
    """
    if spec is None:
        yield None
        return
    local = re.fullmatch(r"local:([1-9]\d{0,3})", spec)
    if not local and not re.fullmatch(r"(tcp|tls)://[^/\s]+:\d+", spec):
        raise ClusterError(f"--cluster {spec}: write local:2 for processes on this machine, or tcp://host:8786")
    if local and int(local[1]) > MAX_WORKERS_PER_CORE * cores():
        limit = f"at most {MAX_WORKERS_PER_CORE * cores()} processes on the {cores()} cores of this machine"
        raise ClusterError(f"--cluster {spec}: {limit}")
    try:
        import dask
        import distributed
    except ImportError:
        raise ClusterError(
            'a cluster needs Dask, which is not installed; install it with: pip install "edhas_jax[cluster]"'
        ) from None
    # Dask logs a traceback for a lost scheduler, which is reported in a sentence instead
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL + 1)
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set({
            "distributed.scheduler.allowed-failures": MAX_WORKER_FAILURES,
            "distributed.admin.large-graph-warning-threshold": LARGEST_CALL,
        }))  # fmt: skip
        address = spec
        if local:
            with _workers_ignore_interrupts():
                address = stack.enter_context(distributed.LocalCluster(
                    n_workers=int(local[1]), threads_per_worker=1, processes=True, dashboard_address=None,
                    silence_logs=50, env={"EDHAS_CORES": str(max(1, cores() // int(local[1])))},
                ))  # fmt: skip
        try:
            client = stack.enter_context(distributed.Client(address, timeout=SCHEDULER_TIMEOUT))
        except (OSError, TimeoutError, ValueError):
            seconds = f"{SCHEDULER_TIMEOUT:.0f} s"
            raise ClusterError(f"no scheduler answers at {spec} within {seconds}; nothing was computed") from None
        _check_workers(client, spec, versions)
        yield client.get_executor(pure=False)


@contextlib.contextmanager
def _workers_ignore_interrupts() -> Iterator[None]:
    """Workers started in this context get no Ctrl-C, which a terminal sends to all processes; the client ends them.

    One that comes meanwhile reaches the client when the context ends. Threads and processes keep the signals that are
    blocked where they are started.
    """
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _check_workers(client, spec: str, versions: Callable[[], dict[str, str]]) -> None:
    """Raise ClusterError unless there is a worker, and all workers have the versions of this process."""
    try:
        client.wait_for_workers(1, timeout=WORKER_TIMEOUT_FACTOR * SCHEDULER_TIMEOUT)
    except TimeoutError:
        raise ClusterError(f"the scheduler at {spec} has no workers; nothing was computed") from None
    try:
        found = client.run(versions)
    except Exception as error:
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ClusterError(f"the workers at {spec} cannot load edhas_jax: {what}") from None
    for worker, theirs in found.items():
        if theirs != versions():
            listed = ", ".join(f"{k} {v} instead of {versions()[k]}" for k, v in theirs.items() if versions()[k] != v)
            raise ClusterError(f"the worker {worker} has {listed}; install the same version everywhere")
