"""All checkable results of Actuators 2022, 11(10), 281 beside ours in one table, and its six figures redrawn.

    python -m studies.paper [--calibrate] [--draws 128] [--out FOLDER]

Two machines are compared with the paper: the nominal one (configs/paper.yaml) and the calibrated one
(configs/paper_calibrated.yaml), whose unstated quantities are set once, within published ranges, to reproduce the
paper's simulated figures; `--calibrate` repeats this and writes both configurations. A figure counts as determined by
the paper's parameters if machines that differ in all unstated quantities nearly agree on it. The last line gives the
largest error of these figures against the paper's simulation.
"""

import argparse
from pathlib import Path

import numpy as np
from rich.console import Console

from edhas_jax.config.machine_config import ConfigError
from studies.paper.calibration import calibrate
from studies.paper.configs import CONFIGS, NAMES, machines, quantities_of, write_configs
from studies.paper.figures import CALIBRATED, NOMINAL, Machines, save_pictures
from studies.paper.published_numbers import CALIBRATION_TARGETS, FIGURES, FITTED
from studies.paper.readings import FREQUENCIES, all_figures
from studies.paper.table import (
    determined,
    error_table,
    figure_spreads,
    figure_table,
    parameter_table,
    spread_table,
    step_variant_table,
    worst_error,
)

NOMINAL_CONFIGS = ("paper", "paper_step")


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Read or recalibrate the machines, print the tables, write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--calibrate", action="store_true", help="set anew what the paper does not print")
    parser.add_argument("--configs", type=Path, default=CONFIGS, help="folder of the calibrated configurations")
    parser.add_argument("--draws", type=int, default=128, help="machines drawn, a power of 2")
    parser.add_argument("--out", type=Path, default=Path("runs/paper"), help="folder for the pictures")
    options = parser.parse_args(arguments)
    if options.draws < 8:
        parser.error(f"--draws {options.draws}: at least 8 machines are needed for a spread")
    if not options.configs.is_dir():
        parser.error(f"--configs {options.configs}: no such folder")
    console = Console(highlight=False, width=120)
    nominal = machines(NOMINAL_CONFIGS)
    if options.calibrate:
        recalibrate(nominal, options.configs, console)
    try:
        calibrated = machines(NAMES, options.configs)
    except ConfigError as error:
        parser.error(f"{error}; --calibrate writes the calibrated configurations")

    with console.status("reading the figures of both machines"):
        found = [figures_of(*pair) for pair in (nominal, calibrated)]
    with console.status(f"drawing {options.draws} machines from what the paper leaves open: a minute"):
        spread = figure_spreads(*nominal, options.draws)
    with console.status("drawing the six figures"):
        pair = (Machines(*nominal, "nominal", NOMINAL), Machines(*calibrated, "calibrated", CALIBRATED))
        paths = save_pictures(*pair, FREQUENCIES, options.out)
    console.print(figure_table(*found, spread))
    console.print(spread_table(spread))
    console.print(error_table(*found))
    console.print(step_variant_table(calibrated[1]))
    console.print(parameter_table(quantities_of(calibrated[0]), quantities_of(nominal[0])))
    console.print("pictures: " + ", ".join(str(path) for path in paths), soft_wrap=True)
    keys = determined(spread)
    worst, fitted = worst_error(tuple(found), keys), worst_error((found[1],), FITTED)
    print(f"worst_error={worst:.4f} determined={','.join(keys)} worst_fitted={fitted:.4f}")
    return {"worst_error": worst, "worst_fitted": fitted} | {k: found[1][k] for k in FIGURES}


def recalibrate(nominal, folder: Path, console: Console) -> None:
    """Calibrate the machine and write its configurations."""
    with console.status("calibrating: a minute") as status:
        best = calibrate(nominal[0], lambda n, sums: status.update(f"calibrating: step {n}, {sums.min():.3g}"))
    write_configs(*nominal, best.chosen, folder)
    reached = (f"{name} {value:.4g} (aim {CALIBRATION_TARGETS[name][0]:g})" for name, value in best.reached.items())
    console.print(f"calibrated in {best.steps} steps: {', '.join(reached)}", soft_wrap=True)
    ends = ", ".join(f"{s:.4g}" for s in np.sort(best.squared_sums))
    console.print(f"sums of squares at which the starts ended: {ends}", soft_wrap=True)


def figures_of(bench, system) -> dict[str, float]:
    """The figures of one machine by key."""
    row = {"mover_mass": np.array([float(bench.mover.mover_mass)])}
    found = all_figures(bench, system, row, FREQUENCIES)
    return {key: float(found[key][0]) for key in FIGURES}
