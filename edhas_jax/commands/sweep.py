"""The command `edhas sweep`."""

import contextlib
import sys
import time
from pathlib import Path

from edhas_jax.commands.arguments import add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, headed, table
from edhas_jax.commands.interruption import STATUS_INTERRUPTED
from edhas_jax.commands.progress_file import ProgressFile

LOG_INTERVAL = 10.0  # s, between lines of progress where there is no terminal


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("sweep", help="run many designs of a machine; the same command resumes")
    parser.add_argument("config", type=Path, help="configuration of the sweep, YAML")
    parser.add_argument("--out", type=Path, help="folder of the result (default: runs/NAME)")
    parser.add_argument(
        "--cluster", metavar="WHERE", help="hand chunks to Dask: local:2 for processes here, tcp://host:8786"
    )
    add_own_code(parser)
    parser.set_defaults(command=run)


def run(options) -> int | None:
    """Simulate the designs of a sweep that have no result yet; print how many ended with which status."""
    from edhas_jax.design.sweep.config import load_sweep
    from edhas_jax.design.sweep.run import run_sweep

    sweep = load_sweep(options.config, own_code(options))
    require_own_code(options, sweep.machine)
    folder = options.out or Path("runs") / options.config.stem
    out = console()
    began = time.perf_counter()
    progress = _SweepProgress(out, sweep.name or options.config.stem)
    try:
        with progress, _executor(options.cluster) as executor:
            frame = run_sweep(
                sweep, folder, executor, progress.report, lambda remark: out.print(remark, soft_wrap=True)
            )  # fmt: skip
    except KeyboardInterrupt:
        finished = f"{progress.done:,} of {len(sweep):,} designs are finished and saved in {folder}"
        print(f"edhas: interrupted; {finished}; the same command resumes the sweep", file=sys.stderr)
        return STATUS_INTERRUPTED
    computed = len(sweep) - progress.initially_done
    seconds = time.perf_counter() - began
    effort = f"{computed:,} computed in {seconds:.1f} s" if computed else "all of them computed before"
    out.print(headed(sweep.name or options.config.stem, f": {len(sweep):,} designs, {effort}"))
    counts = table(None, "status", "designs", "meaning")
    for (status, reason), group in frame.groupby(["status", "reason"], sort=False):
        counts.add_row(status, f"{len(group):,}", reason)
    out.print(counts)
    out.print(f"written to {folder}: table.parquet; look at it with: edhas plot sweep {folder}", soft_wrap=True)
    return None


def _executor(address: str | None):
    """A context manager with the Dask executor at an address, or None without one."""
    if address is None:
        return contextlib.nullcontext()
    from edhas_jax.design.sweep.dask_cluster import dask_executor

    return dask_executor(address)


class _SweepProgress:
    """Designs done, designs per second and time left: a bar in a terminal, a line every ten seconds in a log."""

    def __init__(self, out, name: str):
        from rich.progress import BarColumn, Progress, TextColumn

        self.initially_done, self.done, self._rate_start_count = None, 0, None
        self._file = ProgressFile()
        self._out, self._name = out, name
        self._bar = Progress(
            TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[status]}"),
            transient=True, console=out, disable=not out.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task(name, total=1, status="compiling")
        self._rate_start_time = self._last_line_time = time.perf_counter()

    def __enter__(self):
        self._bar.start()
        return self

    def __exit__(self, *_):
        self._bar.stop()

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
        self._bar.update(self._task, completed=done, total=total, status=status)
        self._file.report(status, done / max(total, 1))
        if not self._out.is_terminal and now - self._last_line_time > LOG_INTERVAL:
            self._last_line_time = now
            self._out.print(f"{self._name}: {status}", soft_wrap=True)


def _duration(seconds: float) -> str:
    """A duration [s] as text, such as "3 min 05 s"."""
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s" if minutes else f"{seconds} s"
