"""A sweep over the design space of a sizing task, and the ranges in which its best designs lie.

    python -m studies.sizing.design_space [--points 10000] [--out FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console

from edhas_jax.core.plot_style import COLOURS
from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import sobol_sequence
from edhas_jax.design.sizing.config import load_sizing
from studies import CONFIGS

CONFIG = CONFIGS / "size_pump.yaml"
BEST_SHARE = 0.01  # of the valid designs
LITRES_PER_MINUTE = 6e4  # per m³/s


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Sweep the bounds of a sizing task at 20 Hz, print the ranges of the best designs, write table and picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--points", type=int, default=10_000)
    parser.add_argument("--out", type=Path, default=Path("runs/design_space"))
    options = parser.parse_args(arguments)
    task = load_sizing(options.config)
    designs = sobol_sequence(task.variables, options.points, seed=3)
    with Console().status("sweeping"):
        got = run_designs(task.machine, designs | {"frequency": np.full(options.points, 20.0)}, task.settings)
    table = pd.DataFrame(designs | got)
    valid = table[table["status"] == 0]
    objective = valid["mean_flow"] * valid["overall_efficiency"]
    best = valid.loc[objective.nlargest(max(5, int(BEST_SHARE * len(valid)))).index]
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_parquet(options.out / "table.parquet")
    draw_design_space(task, valid, best).savefig(options.out / "design_space.png", dpi=130)
    for axis in task.variables:
        low, high = best[axis.name].quantile([0.1, 0.9])
        print(f"{axis.name}: the best designs lie in {low:.3g} … {high:.3g} of {axis.low:.3g} … {axis.high:.3g} (SI)")
    best_flow = best["mean_flow"].max() * LITRES_PER_MINUTE
    print(f"designs={options.points} sound={len(valid)} best_flow_lpm={best_flow:.3f} "
          f"best_efficiency={valid['overall_efficiency'].max():.3f}")  # fmt: skip
    return {"sound": len(valid) / options.points}


def draw_design_space(task, valid: pd.DataFrame, best: pd.DataFrame):
    """Draw efficiency over flow of all valid designs, and the positions of the best within the bounds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    sample = valid.sample(min(len(valid), 4000), random_state=0)
    dots = left.scatter(
        sample["mean_flow"] * LITRES_PER_MINUTE, 100 * sample["overall_efficiency"],
        c=1e3 * sample["piston_diameter"], s=5, cmap="viridis", linewidths=0,
    )  # fmt: skip
    left.scatter(best["mean_flow"] * LITRES_PER_MINUTE, 100 * best["overall_efficiency"], s=12, facecolors="none",
                 edgecolors=COLOURS[1], linewidths=0.8, label="best 1 % in flow × efficiency")  # fmt: skip
    left.set(xlabel="mean flow, L/min", ylabel="overall efficiency, %")
    left.legend(frameon=False, fontsize=8.5)
    figure.colorbar(dots, ax=left, pad=0.01, label="piston diameter, mm").outline.set_visible(False)
    shares = [np.log(best[a.name] / a.low) / np.log(a.high / a.low) if a.log
              else (best[a.name] - a.low) / (a.high - a.low) for a in task.variables]  # fmt: skip
    right.boxplot(shares, orientation="horizontal", widths=0.5, showfliers=False,
                  medianprops={"color": COLOURS[1], "lw": 2})  # fmt: skip
    right.set_yticks(range(1, len(task.variables) + 1), [a.name.replace("_", " ") for a in task.variables])
    right.set(xlim=(0, 1), xlabel="position of the best within the bounds, 0 … 1")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{len(valid):,} pumps at 20 Hz", x=0.01, ha="left", fontsize=11)
    return figure


if __name__ == "__main__":
    main()
