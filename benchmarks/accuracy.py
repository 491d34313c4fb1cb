"""How far the model is from an independent solver, of what order the step is, and how well energy and oil close.

    python benchmarks/accuracy.py [--reference DIR] [--out FILE.csv]
"""

import argparse
import sys
from pathlib import Path

import jax
import numpy as np
import pandas as pd

jax.config.update("jax_enable_x64", True)  # for what this benchmark computes by itself
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import edhas_jax as edhas  # noqa: E402
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage  # noqa: E402
from edhas_jax.simulation.integrator import DEFAULT_STEP  # noqa: E402
from tests.support.convergence import convergence, stretches  # noqa: E402
from tests.support.reference import DATA, EXCEPTIONS, cases, differences, mean_flow_error, rms, run_of, trajectory  # noqa: E402

STEPS = {"default": DEFAULT_STEP, "quarter": DEFAULT_STEP / 4.0}
STARVED_PRESSURES = (20e3, 50e3, 100e3)  # Pa at rest
FINEST_STEP = 1e-6  # s
DIGITS = 8  # of the numbers in the reference
SECOND_ORDER = 3.0  # from the default step to a quarter a second-order error falls 16-fold; below this it does not


def main() -> None:
    """Print the tables; the last line sums them up as key=value."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--reference", type=Path, default=DATA, help="folder with index.yaml and the trajectories")
    options.add_argument("--out", type=Path, help="write the table of signals to this CSV file")
    options = options.parse_args()
    folder = options.reference.resolve()

    signals, runs = compare(folder)
    print_signals(signals, runs)
    exceptions = print_exceptions(signals)
    order = print_order()
    print_balances(runs)
    starved = print_starved()
    if options.out:
        signals.drop(columns="differences").to_csv(options.out, index=False)

    plain = signals[~signals["exception"]]
    flows = runs["mean_flow_error_default"].abs().max()
    print(
        f"worst_nrmse={plain['nrmse_default'].max():.3g} worst_mean_flow_error={flows:.3g} order={order:.3g} "
        f"worst_nrmse_quarter={plain['nrmse_quarter'].max():.3g} exceptions={exceptions} "
        f"energy_residual={runs['energy_default'].abs().max():.3g} "
        f"volume_residual={runs['volume_default'].abs().max():.3g} starved_flow_error={starved:.3g}"
    )


def compare(folder: Path) -> tuple[pd.DataFrame, pd.DataFrame]:
    """One row per trajectory and signal, and one per trajectory."""
    signals, runs = [], []
    for name in cases(folder):
        by_step, row = {}, {"trajectory": name}
        for label, step in STEPS.items():
            run = run_of(name, step, folder=folder)
            by_step[label] = differences(name, run, folder)
            flow = mean_flow_error(name, run, folder)
            row |= {
                f"mean_flow_error_{label}": np.nan if flow is None else flow,
                f"energy_{label}": run.energy_residual(),
                f"volume_{label}": run.volume_residual(),
            }
        runs.append(row)
        for signal, d in by_step["default"].items():
            signals.append(
                {
                    "trajectory": name,
                    "signal": signal,
                    "nrmse_default": rms(d),
                    "nrmse_quarter": rms(by_step["quarter"][signal]),
                    "worst_at": trajectory(name, folder)["time"][int(np.argmax(np.abs(d)))],
                    "rounding": rounding(trajectory(name, folder)[signal]),
                    "exception": (name, signal) in EXCEPTIONS,
                    "differences": {label: by_step[label][signal] for label in STEPS}
                    | {"time": trajectory(name, folder)["time"]},
                }
            )
    return pd.DataFrame(signals), pd.DataFrame(runs)


def rounding(values: np.ndarray) -> float:
    """Rms of the rounding of a recorded signal, as a share of its range: no model can be nearer than this."""
    size, span = np.abs(values).max(), np.ptp(values)
    return float(10.0 ** (np.floor(np.log10(size)) - DIGITS + 1) / np.sqrt(12.0) / span) if span > 0.0 else 0.0


def print_signals(signals: pd.DataFrame, runs: pd.DataFrame) -> None:
    """NRMSE of every signal, grouped by trajectory, the worst signal marked."""
    print(f"NRMSE = rms(model − reference)/(max − min of the reference); steps {DEFAULT_STEP * 1e6:g} µs and a quarter")
    print("* worst of its trajectory   ! named exception, see below\n")
    for row in runs.itertuples():
        flow = ""
        if not np.isnan(row.mean_flow_error_default):
            flow = f"   mean flow {row.mean_flow_error_default:+.1e}, quarter {row.mean_flow_error_quarter:+.1e}"
        print(f"{row.trajectory}{flow}")
        of_run = signals[signals["trajectory"] == row.trajectory]
        for s in of_run.itertuples():
            mark = "!" if s.exception else "*" if s.nrmse_default == of_run["nrmse_default"].max() else " "
            print(
                f"  {mark} {s.signal:<22}{s.nrmse_default:9.1e}{s.nrmse_quarter:9.1e}"
                f"   largest difference at {s.worst_at:.4f} s"
            )
    print("\nworst signal of each trajectory, exceptions apart")
    plain = signals[~signals["exception"]]
    for s in plain.loc[plain.groupby("trajectory", sort=False)["nrmse_default"].idxmax()].itertuples():
        print(f"  {s.trajectory:<22}{s.signal:<22}{s.nrmse_default:9.1e}{s.nrmse_quarter:9.1e}")


def print_exceptions(signals: pd.DataFrame) -> int:
    """The named exceptions: up to the event, after it, and why."""
    print("\nnamed exceptions (NRMSE as a share of the range over the whole run)")
    print(f"  {'trajectory':<20}{'signal':<20}{'event s':>8}", end="")
    print(f"{'before':>13}{'after':>9}{'quarter: before':>18}{'after':>9}")
    found = 0
    for s in signals[signals["exception"]].itertuples():
        exempt = EXCEPTIONS[s.trajectory, s.signal]
        earlier = s.differences["time"] < exempt.event
        figures = [rms(s.differences[label][part]) for label in STEPS for part in (earlier, ~earlier)]
        print(
            f"  {s.trajectory:<20}{s.signal:<20}{exempt.event:8.3f}"
            f"{figures[0]:13.1e}{figures[1]:9.1e}{figures[2]:18.1e}{figures[3]:9.1e}"
        )
        found += 1
    for reason in dict.fromkeys(EXCEPTIONS[key].reason for key in EXCEPTIONS):
        print(f"  - {reason}")
    slow = signals[(signals["nrmse_default"] > 1e-4) & ~signals["exception"]]
    slow = slow[slow["nrmse_default"] < SECOND_ORDER * slow["nrmse_quarter"]]
    if len(slow):
        print("  further signals that a smaller step improves little, as at a switch of friction; last the rounding of")
        print(f"  the reference itself, which has {DIGITS} digits:")
        for s in slow.itertuples():
            figures = f"{s.nrmse_default:9.1e}{s.nrmse_quarter:9.1e}{s.rounding:9.1e}"
            print(f"    {s.trajectory:<22}{s.signal:<22}{figures}   {s.worst_at:.4f} s")
    return found


def print_order() -> float:
    """The order of convergence by regression on every smooth stretch; the lowest."""
    print("\norder of convergence: slope of log error against log step, error = rms over all states as share of range")
    lowest = np.inf
    for name, stretch in stretches().items():
        c = convergence(stretch)
        lowest = min(lowest, c.order)
        print(f"  {name} ({stretch.begin * 1e3:g} … {stretch.end * 1e3:g} ms: {stretch.why}): {c.order:.3f}")
        print("    " + "  ".join(f"{h * 1e6:g} µs {e:.1e}" for h, e in zip(c.steps, c.errors, strict=True)))
    return lowest


def print_balances(runs: pd.DataFrame) -> None:
    """What the ledgers of energy and oil do not account for."""
    print("\nresidual of the ledgers, as a share of what was turned over")
    print(f"  {'':<22}{'energy':>10}{'quarter':>10}{'oil':>12}{'quarter':>10}")
    for r in runs.itertuples():
        print(f"  {r.trajectory:<22}{r.energy_default:10.1e}{r.energy_quarter:10.1e}", end="")
        print(f"{r.volume_default:12.1e}{r.volume_quarter:10.1e}")


def print_starved() -> float:
    """The error of the mean flow of a starved pump; the largest at the lowest pressure at rest."""
    print("\nstarved pump at 40 Hz, mean flow over the whole cycles after the ramp, error against a step of 1 µs")
    pump, worst = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir())), {}
    full = mean_flow(edhas.change(pump, frequency=40.0, accumulator_pressure=0.2e6), DEFAULT_STEP)
    for pressure in STARVED_PRESSURES:
        machine = edhas.change(pump, frequency=40.0, accumulator_pressure=pressure)
        exact = mean_flow(machine, FINEST_STEP)
        errors = [mean_flow(machine, step) / exact - 1.0 for step in STEPS.values()]
        worst[pressure] = abs(errors[0])
        print(f"  {1e-3 * pressure:4.0f} kPa at rest: {exact / full:6.3f} of the flow at 200 kPa, error "
              + ", quarter step ".join(f"{100 * e:+.3f} %" for e in errors))  # fmt: skip
    return worst[min(worst)]


def mean_flow(machine, step: float) -> float:
    """The mean flow [m³/s] of a run of 0.5 s."""
    return edhas.simulate(machine, edhas.Simulation(duration=0.5, step=step)).metrics["mean_flow"].value


if __name__ == "__main__":
    main()
