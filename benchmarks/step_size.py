"""The largest step that keeps mean flow and every signal of the pump bench within bounds, by frequency and precision.

    python benchmarks/step_size.py [--reference DIR]
"""

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from edhas_jax.simulation.run import SimulationError
from edhas_jax.simulation.run_settings import Precision  # noqa: E402
from tests.support.reference import DATA, mean_flow_error, nrmse, run_of  # noqa: E402

SAMPLE_INTERVAL = 200e-6
LADDER = tuple(SAMPLE_INTERVAL / n for n in (40, 20, 10, 8, 6, 5, 4, 3, 2))  # 5 … 100 µs
FREQUENCIES = (5, 10, 20, 30, 40)
MEAN_FLOW, NRMSE = 1e-3, 1e-2


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--reference", type=Path, default=DATA, help="folder with index.yaml and the trajectories")
    folder = options.parse_args().reference.resolve()

    print(f"largest step with mean flow within {MEAN_FLOW:.1%} and every signal within {NRMSE:.0%} of the reference,")
    print("and so at every smaller step of the ladder; mean flow over the whole cycles after the ramp")
    print(f"{'':7}{'':10}{'largest':>9}   {'mean flow, worst signal at that step':<50}first step that fails")
    smallest = {}
    for precision in Precision:
        for frequency in FREQUENCIES:
            good, at_good, at_bad = largest(f"pump_{frequency}hz", precision, folder)
            smallest[precision] = min(smallest.get(precision, good), good)
            print(f"{frequency:4d} Hz  {precision.value:<8}{good * 1e6:7.1f} µs   {at_good:<50}{at_bad}")
    f64, f32 = (1e6 * smallest[precision] for precision in (Precision.FLOAT64, Precision.FLOAT32))
    print(f"smallest_f64_us={f64:.1f} smallest_f32_us={f32:.1f}")


def largest(name: str, precision: Precision, folder: Path) -> tuple[float, str, str]:
    """The largest step before the first that fails, its figures, and the figures of the one that fails."""
    good, at_good = 0.0, "none"
    for step in LADDER:
        try:
            run = run_of(name, step, precision, folder)
        except SimulationError as error:
            return good, at_good, f"{step * 1e6:.1f} µs: {error}"
        flow, errors = mean_flow_error(name, run, folder), nrmse(name, run, folder)
        signal = max(errors, key=errors.__getitem__)
        figures = f"{flow:+.1e}, {signal} {errors[signal]:.1e}"
        if not (abs(flow) <= MEAN_FLOW and errors[signal] <= NRMSE):
            return good, at_good, f"{step * 1e6:.1f} µs: {figures}"
        good, at_good = step, figures
    return good, at_good, "none"


if __name__ == "__main__":
    main()
