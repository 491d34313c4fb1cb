"""First example: the paper's pump at 10 Hz and its 15 mm step, compared with the results in the paper.

    python -m studies.demo.first_run [--out runs/demo]

The last line holds the headline figures as key=value pairs.
"""

import argparse
import shutil
import time
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from edhas_jax.config.machine_config import read_config
from edhas_jax.config.run_folder import save_run
from edhas_jax.core.units import from_si
from edhas_jax.simulation.run import simulate
from studies import CONFIGS


def main(arguments: list[str] | None = None) -> None:
    """Simulate both machines, print the comparison, write two run folders."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, default=Path("runs/demo"), help="folder for the two runs")
    out = parser.parse_args(arguments).out
    began = time.perf_counter()
    console = Console(highlight=False, width=110)
    runs = {}
    for name in ("paper", "paper_step"):
        config = read_config(CONFIGS / f"{name}.yaml")
        with console.status(f"simulating {config.name or name}: compiling takes a few seconds the first time"):
            runs[name] = simulate(config.machine, config.simulation)
        if (out / name / "run.json").exists():
            shutil.rmtree(out / name)
        save_run(runs[name], out / name)
        console.print(f"{config.name or name}: {runs[name].step_note}; written to {out / name}", soft_wrap=True)
    pump, step = runs["paper"].metrics, runs["paper_step"].metrics

    def display_value(metric) -> float:
        return float(from_si(metric.value, metric.unit, metric.display_unit))

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for column in ("quantity", "paper, measured", "paper, simulated", "this model"):
        table.add_column(column, justify="left" if column == "quantity" else "right")
    rise, leak, peak = (display_value(pump[n]) for n in ("pressure_rise", "mean_leakage", "peak_leakage"))
    response, error = display_value(step["response_time"]), display_value(step["steady_error"])
    table.add_row("outlet pressure above the accumulator, 10 Hz", "0.037 MPa", "0.038 MPa", f"{rise:.4f} MPa")
    table.add_row("response to a 15 mm step", "0.392 s", "0.3785 s", f"{response:.4f} s")
    table.add_row("steady error of the step", "≤ 0.103 mm", "about 0", f"{error / 1000:.4f} mm")
    table.add_row("leakage past the plungers, mean, 10 Hz", "", "< 0.005 L/min", f"{leak:.5f} L/min")
    table.add_row("leakage past one plunger, largest, 10 Hz", "", "0.015 L/min", f"{peak:.5f} L/min")
    table.add_row("phase lag of the piston, 10 Hz", "1.57°", "1.21°", f"{display_value(pump['phase_lag']):.2f}°")
    loss = 100 * (1 - pump["amplitude_ratio"].value)
    table.add_row("amplitude loss of the piston, 10 Hz", "0.86 %", "0.57 %", f"{loss:.2f} %")
    table.add_row("mean flow, 10 Hz", "", "", f"{display_value(pump['mean_flow']):.4f} L/min")
    console.print(table)
    console.print("pictures: " + ", ".join(str(out / name / "figure.png") for name in runs))
    print(
        f"pressure_mpa={rise:.4f} response_s={response:.4f} leakage_lpm={leak:.5f} "
        f"seconds={time.perf_counter() - began:.1f}"
    )


if __name__ == "__main__":
    main()
