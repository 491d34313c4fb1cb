"""The command `edhas sweep`."""

import contextlib
import dataclasses
import time
from pathlib import Path

from edhas_jax.commands.arguments import add_cluster, add_output_options, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("sweep", help="run many designs of a machine; the same command resumes")
    parser.add_argument("config", type=Path, help="configuration of the sweep, YAML")
    parser.add_argument("--out", type=Path, help="folder of the result (default: runs/NAME)")
    add_cluster(parser, "hand chunks to Dask")
    add_own_code(parser)
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Simulate the designs of a sweep that have no result yet; print how many ended with which status.

    Raises:
        KeyboardInterrupt: the user has interrupted it; the text says what is finished.
    """
    from edhas_jax.design.sweep.config import load_sweep
    from edhas_jax.design.sweep.run import stream_sweep, sweep_parts
    from edhas_jax.design.sweep.sweep_summary import summary_of_parts

    sweep = load_sweep(options.config, own_code(options))
    require_own_code(options, sweep.machine)
    folder = options.out or Path("runs") / options.config.stem
    out, name = console(options), sweep.name or options.config.stem
    began = time.perf_counter()
    with WorkProgress(options, f"{name}: compiling") as work:
        progress = _SweepProgress(work, name)
        try:
            with _executor(options.cluster) as executor:
                stream_sweep(sweep, folder, executor, progress.report, lambda remark: out.print(remark, soft_wrap=True))
        except KeyboardInterrupt:
            finished = f"{progress.done:,} of {len(sweep):,} designs are finished and saved in {folder}"
            raise KeyboardInterrupt(f"edhas: interrupted; {finished}; the same command resumes the sweep") from None
    computed = len(sweep) - progress.initially_done
    seconds = time.perf_counter() - began
    effort = f"{computed:,} computed in {seconds:.1f} s" if computed else "all of them computed before"
    summary = summary_of_parts(sweep_parts(folder))
    summary = dataclasses.replace(summary, title=f"{name}: {len(sweep):,} designs, {effort}")
    finish(options, out, summary, folder, f"plot sweep {quoted(folder)}")


def _executor(address: str | None):
    """A context manager with the Dask executor at an address, or None without one."""
    if address is None:
        return contextlib.nullcontext()
    from edhas_jax.design.sweep.dask_cluster import dask_executor

    return dask_executor(address)


class _SweepProgress:
    """Designs done, designs per second and time left."""

    def __init__(self, work: WorkProgress, name: str):
        self.initially_done, self.done, self._rate_start_count = None, 0, None
        self._work, self._name = work, name
        self._rate_start_time = time.perf_counter()

    def report(self, done: int, total: int) -> None:
        """Update the display; `done` of `total` designs are finished."""
        now = time.perf_counter()
        if self.initially_done is None:
            self.initially_done = done
        elif self._rate_start_count is None:
            self._rate_start_count, self._rate_start_time = done, now  # the first chunk includes the compile time
        self.done = done
        status = f"{done:,} of {total:,} designs"
        if self._rate_start_count is not None and done > self._rate_start_count:
            rate = (done - self._rate_start_count) / (now - self._rate_start_time)
            status += f", {rate:.3g} designs/s, {_duration((total - done) / rate)} left"
        elif self.initially_done == done < total:
            status += ", compiling"
        self._work(f"{self._name}: {status}", done / total)


def _duration(seconds: float) -> str:
    """A duration [s] as text, such as "3 min 05 s"."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s" if minutes else f"{seconds} s"
