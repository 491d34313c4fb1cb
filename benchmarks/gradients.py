"""Derivatives against central differences of an independent solver, forward against reverse mode, and what they cost.

    python benchmarks/gradients.py [--folder tests/data] [--finest N]

The costs are multiples of one plain run of the same designs to their periodic state, by the same rule and at the same
step, on one core, every program under the flags that make it fast. The last line sums up as key=value.
"""

import argparse
import os
import time
import tracemalloc
from pathlib import Path

# one core for every program
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})


import jax  # noqa: E402
import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402

import edhas_jax as edhas  # noqa: E402
from edhas_jax.compiler.engines import VARIABLE  # noqa: E402
from edhas_jax.design.batch.batch import BatchSettings, run_designs, steps_per_cycle  # noqa: E402
from edhas_jax.design.gradient.fixed_point import GradientSettings  # noqa: E402
from edhas_jax.design.gradient.forward import forward  # noqa: E402
from edhas_jax.design.gradient.reverse import reverse  # noqa: E402
from edhas_jax.design.gradient.table import parameters_of  # noqa: E402
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage  # noqa: E402

PUMP = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
METRICS = {"mean_flow": "flow_elasticity", "mean_electrical_power": "power_elasticity"}
POINTS = {"10 Hz": (10.0, 4.2e-6), "20 Hz": (20.0, 4.2e-6), "30 Hz": (30.0, 4.2e-6), "20 Hz loaded": (20.0, 1e-6)}
STEPS = (1024, 2048, 4096, 8192, 16384, 32768)
COST_STEPS, COST_DESIGNS, TERMS = 2048, 224, 4


def main() -> None:
    """Print the tables; the last line sums them up as key=value."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    data = Path(__file__).parent.parent / "tests" / "data"
    options.add_argument("--folder", type=Path, default=data, help="where derivatives.csv lies")
    options.add_argument("--finest", type=int, default=STEPS[-1], help="leave out finer steps than this many a cycle")
    options = options.parse_args()
    wanted = reference(options.folder / "derivatives.csv")
    print("steps per cycle, step at 10 and 30 Hz, worst error of an elasticity, worst relative one of those above 0.1")
    worst = {}
    for steps in (s for s in STEPS if s <= options.finest):
        error = errors(wanted, steps)
        large = error[error["wanted"].abs() > 0.1]
        relative = (large["error"] / large["wanted"]).abs()
        k = error["error"].abs().idxmax()
        told = f"{error.metric[k]} by {error.parameter[k]} at {error.point[k]}"
        worst[steps] = error["error"].abs().max()
        print(f"{steps:8}{1e6 / 10 / steps:8.2f} µs{1e6 / 30 / steps:7.2f} µs{worst[steps]:11.2e}{relative.max():11.2e}"
              f"  {told}", flush=True)  # fmt: skip
    default = GradientSettings().steps_per_cycle
    same = forward_against_reverse()
    print(f"forward against reverse, largest difference of an elasticity: {same:.1e}")
    multiples = costs()
    ahead, back = (multiples[f"8 parameters, {mode}"] for mode in ("forward", "reverse"))
    error = worst.get(default, min(worst.values()))
    print(f"worst_elasticity_error={error:.2e} forward8={ahead:.2f} reverse={back:.2f}")


def reference(path: Path) -> pd.DataFrame:
    """The elasticities of the independent solver: a row per point, parameter and metric."""
    table = pd.read_csv(path)
    table.columns = [c.split(" [")[0] for c in table.columns]
    return table.melt(["point", "parameter"], list(METRICS.values()), "metric", "wanted")


def errors(wanted: pd.DataFrame, steps: int) -> pd.DataFrame:
    """`wanted` with the error of each elasticity at so many steps per cycle."""
    names = list(dict.fromkeys(wanted["parameter"]))
    columns = {n: np.full(len(POINTS), float(edhas.get(PUMP, n))) for n in names}
    columns["frequency"], columns["load_orifice_area"] = np.array(list(POINTS.values())).T
    found = forward(PUMP, columns, names, list(METRICS), GradientSettings(steps_per_cycle=steps))
    points, kinds = list(POINTS), {column: metric for metric, column in METRICS.items()}
    error = []
    for row in wanted.itertuples():
        k, metric = points.index(row.point), kinds[row.metric]
        slope = found.slopes[metric][k, names.index(row.parameter)]
        error.append(slope * columns[row.parameter][k] / found.values[metric][k] - row.wanted)
    return wanted.assign(error=error)


def designs(names: list[str], count: int) -> dict[str, np.ndarray]:
    """Pumps around the nominal one, all at 20 Hz."""
    rng = np.random.default_rng(0)
    at = {n: float(edhas.get(PUMP, n)) * rng.uniform(0.97, 1.03, count) for n in names}
    return at | {"frequency": np.full(count, 20.0)}


def forward_against_reverse() -> float:
    """The largest difference of an elasticity, with as many terms."""
    names, metrics = EIGHT, list(METRICS)
    columns, settings = designs(names, 8), GradientSettings(COST_STEPS, 0.0, TERMS)
    ahead = forward(PUMP, columns, names, metrics, settings)
    back = reverse(PUMP, columns, names, metrics, settings)
    sizes = np.stack([columns[n] for n in names], axis=1)
    return max(
        np.abs((ahead.slopes[m] - back.slopes[m]) * sizes / ahead.values[m][:, None]).max() for m in metrics
    )


EIGHT = ["piston_diameter", "piston_clearance", "valve_spring_rate", "valve_mass", "valve_seat_diameter",
         "valve_preload", "frequency", "amplitude"]  # fmt: skip


def costs() -> dict[str, float]:
    """Multiples of a plain run, and peak memory."""
    forty = (EIGHT + [n for n in parameters_of(PUMP) if n not in EIGHT])[:40]
    settings, metric = GradientSettings(COST_STEPS), ["mean_flow"]
    plain = BatchSettings(1.0 / (20.0 * COST_STEPS) * 1.0001, settings.tolerance, settings.max_cycles)
    assert steps_per_cycle(20.0, plain.step) == COST_STEPS
    out, unit = {}, {}
    for names in (EIGHT, forty):
        columns = designs(names, COST_DESIGNS)
        unit[len(names)] = best(lambda c=columns: run_designs(PUMP, c, plain)) / COST_DESIGNS
    cycles = run_designs(PUMP, designs(EIGHT, COST_DESIGNS), plain)["cycles"].mean()
    ns = 1e9 * unit[8] / COST_STEPS / cycles
    print(f"plain run: {cycles:.1f} cycles, {ns:.0f} ns per step and design on one core")
    jobs = {
        "8 parameters, under XLA": lambda: under_xla(designs(EIGHT, COST_DESIGNS), EIGHT, metric, settings),
        "8 parameters, forward": lambda: forward(PUMP, designs(EIGHT, COST_DESIGNS), EIGHT, metric, settings),
        "8 parameters, reverse": lambda: reverse(PUMP, designs(EIGHT, 240), EIGHT, metric, settings),
        "40 parameters, forward": lambda: forward(PUMP, designs(forty, 56), forty, metric, settings),
        "40 parameters, reverse": lambda: reverse(PUMP, designs(forty, 240), forty, metric, settings),
    }
    counts = {"8 parameters, reverse": 240, "40 parameters, reverse": 240, "40 parameters, forward": 56}
    for name, job in jobs.items():
        begin = time.perf_counter()
        terms = job().terms
        compiled = time.perf_counter() - begin
        share = best(job) / counts.get(name, COST_DESIGNS)
        out[name] = share / unit[int(name.split()[0])]
        print(f"{name:32}{out[name]:7.2f} × a plain run; {terms} terms; first call {compiled:.0f} s", flush=True)
    tracemalloc.start()
    reverse(PUMP, designs(forty, 240), forty, metric, settings)
    memory = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    print(f"reverse mode keeps at most {memory / 2**20:.0f} MiB for 240 designs")
    return out


def under_xla(columns, names, metric, settings):
    """Forward mode on the XLA engine."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = "xla"
    try:
        return forward(PUMP, columns, names, metric, settings)
    finally:
        os.environ.pop(VARIABLE) if before is None else os.environ.update({VARIABLE: before})


def best(job, repeats: int = 3) -> float:
    """The shortest time [s] of a job that has been compiled."""
    times = []
    job()
    for _ in range(repeats):
        begin = time.perf_counter()
        jax.block_until_ready(job())
        times.append(time.perf_counter() - begin)
    return min(times)


if __name__ == "__main__":
    main()
