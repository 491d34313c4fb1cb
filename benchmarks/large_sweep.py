"""Sweeps of millions of designs: seconds, memory, size of the table, and seconds of the pictures.

    python benchmarks/large_sweep.py [--simulated N] [--invented N] [--coarse N]

First `--simulated` designs of configs/sweep_pumps.yaml are run as `edhas sweep` runs them. Then the same is done with
`--invented` designs whose metrics are made up, because only the way of the results through files to table and pictures
counts there. Memory is that of the process, of which the libraries take the part that is there before the first chunk;
it is read when a tenth of the designs is done, and at its largest.

With `--coarse` so many designs are simulated by the command `edhas sweep` itself, with the coarsest settings that leave
nearly all of them periodic: the configuration is printed. Memory is then read every second, and told for tenths of
the time. The last line sums up as key=value.
"""

import argparse
import dataclasses
import resource
import tempfile
import threading
import time
from pathlib import Path

import numpy as np

from edhas_jax.commands.cli import main as edhas
from edhas_jax.core import runtime
from edhas_jax.design.batch.experiment_design import sobol_sequence
from edhas_jax.design.sweep import run
from edhas_jax.design.sweep.config import load_sweep
from edhas_jax.design.sweep.folder import ChunkResult
from edhas_jax.design.sweep.identity import device, versions
from edhas_jax.design.sweep.run import ChunkJob
from edhas_jax.machine.metrics import METRICS
from edhas_jax.simulation.validity import Status

ROOT = Path(__file__).parent.parent
CONFIG = ROOT / "configs" / "sweep_pumps.yaml"
KINDS = ("heat", "parallel", "pareto")
COARSE = """\
name: coarse
base: {base}
parameters: {{load_orifice_area: 1 mm²}}
sweep:
  kind: sobol
  count: {count}
  seed: 1
  parameters:
    piston_clearance: {{from: 3 um, to: 60 um, spacing: log}}
    piston_diameter: {{from: 8 mm, to: 16 mm}}
    valve_spring_rate: {{from: 50 N/m, to: 1 kN/m, spacing: log}}
    frequency: {{from: 20 Hz, to: 30 Hz}}
batch: {{step: 100 us, tolerance: 5 %, max_cycles: 4, precision: float32}}
"""


def main() -> None:
    """Run both sweeps; the last line sums up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--simulated", type=int, default=1_000_000, help="designs that are simulated")
    parser.add_argument("--invented", type=int, default=10_000_000, help="designs whose metrics are made up")
    parser.add_argument("--coarse", type=int, default=0, help="designs that are simulated coarsely by `edhas sweep`")
    options = parser.parse_args()
    print(f"{runtime.cores()} cores")
    headline = {}
    if options.coarse:
        headline |= {f"coarse_{name}": value for name, value in by_command(options.coarse).items()}
    for what, count in (("simulated", options.simulated), ("invented", options.invented)):
        if count:
            if what == "invented":
                run.compute_chunk = invented
            headline |= {f"{what}_{name}": value for name, value in measured(what, count).items()}
    print(" ".join(f"{name}={value}" for name, value in headline.items()))


def measured(what: str, count: int) -> dict[str, object]:
    """Run and draw a sweep of so many designs."""
    sweep = load_sweep(CONFIG)
    sweep = dataclasses.replace(sweep, designs=sobol_sequence(sweep.axes, count, sweep.seed))
    with tempfile.TemporaryDirectory() as folder:
        memory: dict[str, float] = {}
        begin = time.perf_counter()

        def report(done: int, total: int) -> None:
            share = "tenth" if done >= total / 10 else "before"
            memory.setdefault(share, resident())
            memory["most"] = max(memory.get("most", 0.0), resident())

        run.stream_sweep(sweep, folder, on_progress=report)
        seconds = time.perf_counter() - begin
        memory["end"] = resident()
        size = (Path(folder) / "table.parquet").stat().st_size / 1e6
        found: dict[str, object] = {"designs": count, "seconds": f"{seconds:.0f}", "table_mb": f"{size:.0f}"}
        found |= {f"mb_{name}": f"{value:.0f}" for name, value in memory.items()}
        found |= pictures(folder)
    print(f"{what}: " + ", ".join(f"{name} {value}" for name, value in found.items()), flush=True)
    return found


def pictures(folder: str) -> dict[str, str]:
    """Seconds of each picture of a sweep."""
    found = {}
    for kind in KINDS:
        begin = time.perf_counter()
        if edhas(["plot", "sweep", folder, "--kind", kind, "--out", f"{folder}/{kind}.png", "--quiet"]):
            raise SystemExit(f"the picture {kind} could not be drawn")
        found[f"{kind}_s"] = f"{time.perf_counter() - begin:.1f}"
    return found


def by_command(count: int) -> dict[str, object]:
    """Run `edhas sweep` with the settings `COARSE`, and draw its pictures."""
    print(COARSE.format(base="configs/paper.yaml", count=count))
    with tempfile.TemporaryDirectory() as folder:
        config, out = Path(folder) / "coarse.yaml", f"{folder}/sweep"
        config.write_text(COARSE.format(base=ROOT / "configs" / "paper.yaml", count=count), encoding="utf-8")
        memory, ended = [resident()], threading.Event()

        def watch() -> None:
            while not ended.wait(1.0):
                memory.append(resident())

        watcher = threading.Thread(target=watch)
        watcher.start()
        begin, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF)
        try:
            failed = edhas(["sweep", str(config), "--out", out])
        finally:
            seconds, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_SELF)
            ended.set()
            watcher.join()
        if failed:
            raise SystemExit("the sweep failed")
        found: dict[str, object] = {"designs": count, "seconds": f"{seconds:.0f}"}
        found["core_seconds"] = f"{after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime:.0f}"
        found["table_mb"] = f"{(Path(out) / 'table.parquet').stat().st_size / 1e6:.0f}"
        for tenth in range(11):
            found[f"mb_at_{10 * tenth}_percent"] = f"{memory[min(tenth * len(memory) // 10, len(memory) - 1)]:.0f}"
        found |= {"mb_most": f"{max(memory):.0f}"} | pictures(out)
    print("coarse: " + ", ".join(f"{name} {value}" for name, value in found.items()), flush=True)
    return found


def invented(job: ChunkJob) -> ChunkResult:
    """Metrics that are smooth functions of the parameters with some noise; one in fifty designs has failed."""
    rng, law = np.random.default_rng(job.number), np.random.default_rng(0)
    columns = [np.log(column / column.mean()) for column in job.values.values()]
    count = len(columns[0])
    metrics = {
        name: np.exp(np.tensordot(law.normal(size=len(columns)) + k % 3, columns, 1) + 0.1 * rng.normal(size=count))
        for k, name in enumerate(METRICS)
    }
    status = np.where(rng.random(count) < 0.02, float(Status.STALLED), float(Status.OK))
    account = {"cycles": np.full(count, 3.0), "residual": np.full(count, 1e-4), "status": status}
    return ChunkResult(job.number, metrics | account, versions(), device())


def resident() -> float:
    """Memory of this process [MB]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return int(line.split()[1]) / 1024
    return float("nan")


if __name__ == "__main__":
    main()
