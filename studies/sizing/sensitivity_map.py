"""Elasticities and Sobol indices of the paper's pump over frequency and load, as heat maps.

    python -m studies.sizing.sensitivity_map [--samples 256] [--out FOLDER]
"""

import argparse
import dataclasses
from pathlib import Path

from rich.console import Console
from rich.table import Table

from edhas_jax.design.sensitivity.config import load_sensitivity
from edhas_jax.tasks.sensitivity import sensitivity
from studies import CONFIGS

CONFIG = CONFIGS / "sensitivity.yaml"


def main(arguments: list[str] | None = None) -> dict[str, str]:
    """Analyse, print the parameter with the largest effect on the flow at every point, write pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--samples", type=int, default=256)
    parser.add_argument("--out", type=Path, default=Path("runs/sensitivity_map"))
    options = parser.parse_args(arguments)
    task = dataclasses.replace(load_sensitivity(options.config), samples=options.samples, trajectories=0)
    with Console().status("analysing") as status:
        findings = sensitivity(task, on_progress=lambda what, share: status.update(f"{what}, {share:.0%}"))
    findings.save(options.out, overwrite=True)
    flow = findings.sobol[findings.sobol["output"] == task.metrics[0]]
    frequency, names = findings.points["frequency"], {}
    table = Table("point", *findings.points.columns, f"largest effect on {task.metrics[0]}", "total index")
    for k, point in findings.points.iterrows():
        at_point = flow[flow["point"] == k]
        strongest = at_point.loc[at_point["total"].idxmax()]
        names[k] = str(strongest["parameter"])
        table.add_row(str(k), *(f"{v:.4g}" for v in point), names[k], f"{strongest['total']:.3f}")
    Console(highlight=False).print(table)
    strongest_at_ends = {"slowest": names[frequency.idxmin()], "fastest": names[frequency.idxmax()]}
    print(" ".join(f"{task.metrics[0]}_{end}={name}" for end, name in strongest_at_ends.items()))
    return strongest_at_ends


if __name__ == "__main__":
    main()
