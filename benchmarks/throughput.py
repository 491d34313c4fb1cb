"""Design-steps per second of the batch engine, by batch, precision and cores, against a C loop of the same step.

    python benchmarks/throughput.py [--out FILE.csv] [--largest N]

Each number of cores is measured in a process of its own that is confined to them; package and C loop take turns, go
through as many steps, and the best of the rounds counts. A share of the C loop is the median over batches. The engine
computes its metrics on the way, the C loop nothing but the state; a second C loop does what the engine does, so that
what the metrics take can be told from what two compilers make of one program.
"""

import argparse
import json
import math
import os
import platform
import subprocess
import sys
import time
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import NamedTuple

import c_loop
import pandas as pd

from edhas_jax.compiler.engines import serving_engine
from edhas_jax.design.batch.batch import BatchSettings, run_designs, steps_per_cycle
from edhas_jax.simulation.integrator import DEFAULT_STEP
from edhas_jax.simulation.run_settings import Precision

BATCHES = (64, 100, 128, 256, 512, 1000, 1024, 2048, 4096, 8192, 10000, 16384)
DTYPES = ("float32", "float64")
SECONDS = 1.5  # of repetitions for each cell; two at least
A_CYCLE = 5000.0  # steps
FULL = 256  # designs from which on every core has enough to do


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--out", type=Path, help="write the table to this CSV file")
    options.add_argument("--largest", type=int, default=BATCHES[-1], help="leave out batches above this one")
    options.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = options.parse_args()
    if options.worker:
        return worker(options.largest)

    cores = sorted(os.sched_getaffinity(0))
    rows = []
    device = processor()
    print(f"{device}, {len(cores)} cores; one step of the pump bench with {len(c_loop.VARIED)} parameters varied")
    if not c_loop.available():
        print("C loop: not installed (g++ is needed)")
    print(f"{'cores':>5}{'dtype':>9}{'batch':>7}{'package':>10}{'C loop':>10}{'with metrics':>14}  M design-steps/s")
    for count in sorted({1, len(cores)}):
        for row in measured(cores[:count], options.largest):
            rows.append({"device": device, "date": date.today().isoformat(), **row, "cores": count})
            print(f"{count:5}{row['dtype']:>9}{row['batch']:7}", end="")
            print(f"{row['rate'] / 1e6:10.2f}{row['c_rate'] / 1e6:10.2f}{row['c_metrics'] / 1e6:14.2f}", flush=True)
    columns = ["device", "engine", "date", "batch", "dtype", "cores", "rate", "c_rate", "c_metrics"]
    table = pd.DataFrame(rows)[columns]
    if options.out:
        table.to_csv(options.out, index=False)
    table = table[table["cores"] == len(cores)]
    best = table.groupby("dtype")["rate"].max()
    # machines drift: what was measured in turns is compared, batch by batch
    full = table[table["batch"] >= min(FULL, table["batch"].max())].set_index("dtype")
    bare, whole = ((full["rate"] / full[name]).groupby("dtype").median() for name in ("c_rate", "c_metrics"))
    print("share of the C loop that computes the metrics too: " + ", ".join(f"{n} {whole[n]:.2f}" for n in DTYPES))
    print(
        f"f32={best['float32']:.4g} f64={best['float64']:.4g} "
        f"c_ratio_f32={bare['float32']:.3g} c_ratio_f64={bare['float64']:.3g}"
    )


def processor() -> str:
    """The name of the processor."""
    info = Path("/proc/cpuinfo")
    names = [line for line in info.read_text().splitlines() if line.startswith("model name")] if info.exists() else []
    return names[0].split(":")[1].strip() if names else platform.processor() or platform.machine()


def measured(cores: list[int], largest: int):
    """The rows of a process that is confined to these cores, as they come."""
    command = [sys.executable, __file__, "--worker", "--largest", str(largest)]
    with c_loop.confined(cores):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    with process:
        for line in process.stdout:
            yield json.loads(line)
    if process.returncode:
        sys.exit(f"a measurement on {len(cores)} cores failed")


def worker(largest: int) -> None:
    """One line of JSON for each batch and precision, on the cores of this process."""
    cores = len(os.sched_getaffinity(0))
    for dtype in DTYPES:
        made = (c_loop.of_bench, c_loop.of_cycle) if c_loop.available() else ()
        loop, whole = [make(dtype) for make in made] or (None, None)
        for batch in (b for b in BATCHES if b <= largest):
            jobs = {"rate": package_job(batch, dtype, cores)}
            if loop is not None:
                jobs |= {"c_rate": c_job(loop, batch, cores), "c_metrics": c_job(whole, batch, cores, A_CYCLE)}
            row = {"engine": serving_engine().name, "batch": batch, "dtype": dtype}
            print(json.dumps(row | {"c_rate": math.nan, "c_metrics": math.nan} | rates(jobs)), flush=True)


class Job(NamedTuple):
    """Something to be timed, and the design-steps that it takes."""

    run: Callable[[], object]
    design_steps: int


def package_job(batch: int, dtype: str, cores: int) -> Job:
    """One cycle of the engine; it uses the cores this process is confined to."""
    if cores != len(os.sched_getaffinity(0)):
        raise ValueError(f"this process is not set up for {cores} cores")
    machine, values = c_loop.bench_machine(), c_loop.designs(batch, "float64")
    # no cycle counts as periodic, so that each design takes the same number of steps
    settings = BatchSettings(tolerance=-1.0, max_cycles=1, precision=Precision(dtype))
    run_designs(machine, {n: v[:1] for n, v in values.items()}, settings)
    steps = steps_per_cycle(values["frequency"], DEFAULT_STEP)
    return Job(lambda: run_designs(machine, values, settings), int(steps.sum()))


def c_job(loop: c_loop.Loop, batch: int, cores: int, h: float = DEFAULT_STEP) -> Job:
    """As many steps of a C loop."""
    values = c_loop.designs(batch, str(loop.dtype))
    steps = int(steps_per_cycle(values["frequency"], DEFAULT_STEP).mean())
    return Job(lambda: loop(values, steps, h, cores), batch * steps)


def rates(jobs: dict[str, Job]) -> dict[str, float]:
    """Design-steps per second of each job, the best of the rounds that go into `SECONDS` for each."""
    best, spent, rounds = dict.fromkeys(jobs, math.inf), 0.0, 0
    while rounds < 2 or spent < SECONDS * len(jobs):
        for name, job in jobs.items():
            begin = time.perf_counter()
            job.run()
            took = time.perf_counter() - begin
            best[name], spent = min(best[name], took), spent + took
        rounds += 1
    return {name: jobs[name].design_steps / seconds for name, seconds in best.items()}


if __name__ == "__main__":
    main()
