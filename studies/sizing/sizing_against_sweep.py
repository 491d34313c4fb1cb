"""Sizing from several starts compared with a sweep over the same design space.

    python -m studies.sizing.sizing_against_sweep [--config FILE] [--points 20000] [--starts 64] [--out FOLDER]

Both use the same objective and limits. In the last line `gain` is the relative improvement of the objective of the
sized design over the best of the sweep (exponential of the difference of the mean logarithms, minus one).
"""

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import sobol_sequence
from edhas_jax.design.sizing.config import SizingTask, load_sizing
from edhas_jax.design.sizing.figures import draw_path
from edhas_jax.design.sizing.problem import SizingProblem
from edhas_jax.design.sizing.size import size
from studies import CONFIGS

CONFIG = CONFIGS / "size_pump.yaml"
FINEST_STEPS = 4096  # per cycle
SUPPLY_VOLTAGE = 48.0  # V; designs whose voltage saturates are not allowed


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Run both, print the best designs, write a picture of the starts."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--points", type=int, default=20_000, help="designs of the sweep")
    parser.add_argument("--starts", type=int, default=64)
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--out", type=Path, default=Path("runs/sizing_against_sweep"))
    options = parser.parse_args(arguments)
    task = load_sizing(options.config)
    task = dataclasses.replace(task, starts=options.starts, iterations=options.iterations)
    console = Console(highlight=False)
    with console.status("sweeping") as status:
        design, best, seconds, machine_seconds = sweep(
            task, options.points, lambda done, total: status.update(f"sweeping, {done:,} of {total:,}")
        )
        values = ", ".join(f"{n} {v:.4g}" for n, v in design.items())
        console.print(f"sweep: J = {best:.4f} at {values}; {machine_seconds:,.0f} machine-seconds in {seconds:.0f} s")
        result = size(task, lambda what, share: status.update(what))
    sized = result.machines[0]
    values = ", ".join(f"{n} {v:.4g}" for n, v in sized.design.items())
    console.print(f"sized: J = {sized.objective:.4f} at {values}; {result.machine_seconds:,.0f} machine-seconds in "
                  f"{result.seconds:.0f} s; limited by {'; '.join(sized.active)}")  # fmt: skip
    # both designs are evaluated with the finest step
    problem = SizingProblem(task, FINEST_STEPS)
    fractions = [
        [a.fraction_of(v) for a, v in zip(task.variables, d.values(), strict=True)] for d in (design, sized.design)
    ]
    evaluation = problem.evaluate(np.array(fractions))
    gain = float(np.expm1(evaluation.objective[1] - evaluation.objective[0]))
    options.out.mkdir(parents=True, exist_ok=True)
    draw_path(task, result).savefig(options.out / "starts.png", dpi=130)
    summary = {
        "gain": gain, "violation": float(evaluation.violation[1]), "starts_within_1_percent": result.share_near_best,
        "machine_seconds_sizing": result.machine_seconds, "machine_seconds_sweep": machine_seconds,
    }  # fmt: skip
    print(" ".join(f"{n}={v:.4g}" for n, v in summary.items()))
    return summary


def sweep(task: SizingTask, points: int, on_chunk) -> tuple[dict[str, float], float, float, float]:
    """The best design of a Sobol sequence within all limits: (design in SI, its J, seconds, machine-seconds)."""
    began = time.perf_counter()
    designs, cases = sobol_sequence(task.variables, points, seed=1), task.operating_points()
    count = len(next(iter(cases.values())))
    table = {n: np.repeat(v, count) for n, v in designs.items()} | {n: np.tile(v, points) for n, v in cases.items()}
    got = run_designs(task.machine, table, task.settings, on_chunk)
    machine_seconds = float(np.sum(got["cycles"] / table["frequency"]))
    got = {n: v.reshape(points, count) for n, v in got.items()}
    allowed = (got["status"] == 0).all(axis=1) & (got["peak_voltage"] < SUPPLY_VOLTAGE * (1 - 1e-3)).all(axis=1)
    for limit in task.constraints:
        value = got[limit.metric]
        allowed &= ((value <= limit.value) if limit.upper else (value >= limit.value)).all(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        objective = sum(w * np.log(got[m]).mean(axis=1) for m, w in task.weights.items())
    best = int(np.argmax(np.where(allowed, objective, -np.inf)))
    design = {n: float(v[best]) for n, v in designs.items()}
    return design, float(objective[best]), time.perf_counter() - began, machine_seconds


if __name__ == "__main__":
    main()
