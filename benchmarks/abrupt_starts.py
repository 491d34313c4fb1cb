"""Random designs at abrupt starts and high frequency: does any end on a false periodic solution?

    python benchmarks/abrupt_starts.py [--count 1000] [--step 20e-6]

Each design starts at full amplitude and is run to its periodic state at the step, at half and at a tenth of it. Those
that the batch calls periodic and valid must agree with the finest; what it flags is counted by reason. A machine may
have more than one periodic motion, and which it comes to from an abrupt start may hang on the step: where two differ,
the one found at the larger step is gone on with at the finest. If it stays, the equations have it, and it is not false.
The last line holds the figures.
"""

import argparse
import time

import jax
import numpy as np
from scipy.stats import qmc

import edhas_jax as edhas
from edhas_jax.design.batch.batch import BatchSettings, Status, plan_chunks, run_designs
from edhas_jax.design.batch.periodic_solver import run_to_periodic
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage

RANGES = {
    "frequency": (15.0, 60.0), "amplitude": (1e-3, 4.5e-3), "piston_diameter": (8e-3, 16e-3),
    "valve_mass": (1e-3, 8e-3), "valve_spring_rate": (50.0, 800.0), "load_orifice_area": (1e-7, 8e-6),
    "air_fraction": (5e-4, 3e-2), "accumulator_pressure": (0.05e6, 0.5e6), "piston_clearance": (5e-6, 40e-6),
}  # fmt: skip
AGREE = 0.01
STAYS = 12  # cycles at the finest step after which a motion must still be the same
MACHINE = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
FINER = 0.5  # share of the step at which the comparison is made once more


def main() -> None:
    """Run the comparisons and print their tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--step", type=float, default=20e-6, help="seconds")
    options = parser.parse_args()
    unit = qmc.LatinHypercube(len(RANGES), rng=1).random(options.count)
    designs = {n: low * (high / low) ** unit[:, k] for k, (n, (low, high)) in enumerate(RANGES.items())}
    finest = options.step / 10.0
    fine, coarse = (periodic(designs, step) for step in (finest, options.step))
    wrong, others = compare(designs, coarse, fine, options.step, finest)
    finer = compare(designs, periodic(designs, FINER * options.step), fine, FINER * options.step, finest)
    ok = int((coarse["status"] == Status.OK).sum())
    print(f"designs={options.count} ok={ok} flagged={options.count - ok} false={wrong} "
          f"false_at_half_the_step={finer[0]} second_solutions={others}")  # fmt: skip


def settings(step: float) -> BatchSettings:
    """An abrupt start, and time to settle."""
    return BatchSettings(step=step, soft_start=False, max_cycles=40)


def periodic(designs: dict[str, np.ndarray], step: float) -> dict[str, np.ndarray]:
    """The metrics of all designs after an abrupt start."""
    began = time.perf_counter()
    found = run_designs(MACHINE, designs, settings(step))
    seconds = time.perf_counter() - began
    counts = {s.name.lower(): int((found["status"] == s).sum()) for s in Status}
    print(f"step {step * 1e6:5.1f} µs, {seconds:6.1f} s: " + ", ".join(f"{n} {c}" for n, c in counts.items() if c))
    return found


def compare(designs: dict[str, np.ndarray], coarse, fine, step: float, finest: float) -> tuple[int, int]:
    """How many designs are called periodic and valid and are not right, and how many are a second solution."""
    ok = coarse["status"] == Status.OK
    scale = np.maximum(np.abs(fine["mean_flow"]), 0.02 * 4.0 * designs["frequency"] * designs["amplitude"] * (
        0.25 * np.pi * designs["piston_diameter"] ** 2
    ))  # fmt: skip
    error = np.abs(coarse["mean_flow"] - fine["mean_flow"]) / scale
    differ = np.flatnonzero(ok & ~(error <= AGREE))
    print(f"{int(ok.sum())} periodic and valid; error of mean flow: median {np.median(error[ok]):.1e}, ", end="")
    print(f"99 % below {np.quantile(error[ok], 0.99):.1e}, largest {error[ok].max():.1e}")
    stays = [abs(gone_on_with(designs, k, step, finest) / coarse["mean_flow"][k] - 1.0) <= AGREE for k in differ]
    for k, second in zip(differ[:20], stays, strict=False):
        values = ", ".join(f"{n} {v[k]:.4g}" for n, v in designs.items())
        verdict = Status(int(fine["status"][k])).name.lower()
        flows = f"{coarse['mean_flow'][k]:.3e} against {fine['mean_flow'][k]:.3e} m³/s"
        told = "a second solution, which stays at the finest step" if second else "false"
        print(f"  {error[k]:.1%}: {flows} ({verdict} there), {told}: {values}")
    return len(differ) - sum(stays), sum(stays)


def gone_on_with(designs: dict[str, np.ndarray], k: int, step: float, finest: float) -> float:
    """The mean flow of a design that has become periodic at one step and has then gone on at another."""
    one = {n: v[k : k + 1] for n, v in designs.items()}
    steps = [plan_chunks(MACHINE, one, settings(s))[0].steps_per_cycle for s in (step, finest)]
    how = settings(step)
    machine = jax.tree.map(lambda leaf: np.asarray(leaf, float), MACHINE)
    lanes = run_to_periodic(machine, one, steps[0], np.asarray(how.tolerance), how.max_cycles, how.soft_start)
    # a tolerance below zero: all these cycles are run
    lanes = run_to_periodic(machine, one, steps[1], np.asarray(-1.0), STAYS, False, lanes)
    return float(lanes.metrics["mean_flow"][0])


if __name__ == "__main__":
    main()
