"""`edhas sweep` and `edhas plot sweep`."""

import contextlib
import sys
import time
from pathlib import Path

from edhas_jax.commands.console import console, table

INTERRUPTED = 130
SECONDS_PER_LINE = 10.0  # between lines of progress where there is no terminal


def sweep(options) -> int | None:
    """`edhas sweep`: run what is missing of a sweep, with progress, and say what came of its designs."""
    from edhas_jax.design.sweep.config import load_sweep
    from edhas_jax.design.sweep.run import run_sweep

    wanted = load_sweep(options.config)
    folder = options.out or Path("runs") / options.config.stem
    out = console()
    began = time.perf_counter()
    progress = _Progress(out, wanted.name or options.config.stem)
    try:
        with progress, _executor(options.cluster) as executor:
            frame = run_sweep(wanted, folder, executor, progress.report)
    except KeyboardInterrupt:
        kept = f"{progress.done:,} of {len(wanted):,} designs are finished and kept in {folder}"
        print(f"edhas: interrupted; {kept}; the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    computed = len(wanted) - progress.before
    seconds = time.perf_counter() - began
    told = f"{computed:,} computed in {seconds:.1f} s" if computed else "all of them computed before"
    out.print(f"[bold]{wanted.name or options.config.stem}[/bold]: {len(wanted):,} designs, {told}")
    counts = table(None, "status", "designs", "meaning")
    for (status, reason), group in frame.groupby(["status", "reason"], sort=False):
        counts.add_row(status, f"{len(group):,}", reason)
    out.print(counts)
    out.print(f"written to {folder}: table.parquet; look at it with: edhas plot sweep {folder}", soft_wrap=True)
    return None


def _executor(where: str | None):
    if where is None:
        return contextlib.nullcontext()
    from edhas_jax.design.sweep.cluster import executor

    return executor(where)


class _Progress:
    """Designs done, designs per second and time left: a bar in a terminal, a line now and then in a log."""

    def __init__(self, out, name: str):
        from rich.progress import BarColumn, Progress, TextColumn

        self.before, self.done, self._from = None, 0, None
        self._out, self._name = out, name
        self._bar = Progress(
            TextColumn("{task.description}"), BarColumn(), TextColumn("{task.fields[told]}"),
            transient=True, console=out, disable=not out.is_terminal,
        )  # fmt: skip
        self._task = self._bar.add_task(name, total=1, told="compiling")
        self._began = self._line = time.perf_counter()

    def __enter__(self):
        self._bar.start()
        return self

    def __exit__(self, *_):
        self._bar.stop()

    def report(self, done: int, total: int) -> None:
        """Take note of the designs that are finished."""
        now = time.perf_counter()
        if self.before is None:
            self.before = done
        elif self._from is None:
            self._from, self._began = done, now  # the first chunk has waited for the compiler
        self.done = done
        told = f"{done:,} of {total:,} designs"
        if self._from is not None and done > self._from:
            rate = (done - self._from) / (now - self._began)
            told += f", {rate:.3g} designs/s, {_duration((total - done) / rate)} left"
        elif self.before == done < total:
            told += ", compiling"
        self._bar.update(self._task, completed=done, total=total, told=told)
        if not self._out.is_terminal and now - self._line > SECONDS_PER_LINE:
            self._line = now
            self._out.print(f"{self._name}: {told}", soft_wrap=True)


def _duration(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {seconds:02d} s" if minutes else f"{seconds} s"


def plot_sweep(options) -> None:
    """`edhas plot sweep`: draw the pictures of a sweep's result."""
    from edhas_jax.config.run_folder import StoreError
    from edhas_jax.design.sweep.figures import FigureError, draw
    from edhas_jax.design.sweep.run import open_sweep

    result = open_sweep(options.result)
    kinds = ("heat", "parallel", "pareto") if options.kind == "all" else (options.kind,)
    out = console()
    for kind in kinds:
        path = options.out or options.result / f"{kind}.png"
        if options.out and len(kinds) > 1:
            path = options.out.with_name(f"{options.out.stem}_{kind}{options.out.suffix}")
        try:
            figure = draw(
                result, kind, metric=options.metric, x=options.x, y=options.y, slices=options.slices,
                average=options.average, objectives=options.pareto,
            )  # fmt: skip
        except FigureError as error:
            if options.kind != "all" or not error.missing:
                raise StoreError(f"{options.result}: {error}") from None
            out.print(f"no picture {kind}: {error}", soft_wrap=True)
            continue
        try:
            figure.savefig(path, dpi=130)
        except (OSError, ValueError) as error:
            raise StoreError(f"{path}: cannot be written: {error}") from None
        out.print(f"written: {path}", soft_wrap=True)
