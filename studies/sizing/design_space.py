"""What does the space of pumps look like? A sweep of ten thousand, and what its best have in common.

    python -m studies.sizing.design_space [--points 10000] [--out FOLDER]
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd
from rich.console import Console

from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import sobol_sequence
from edhas_jax.design.sizing.config import load_sizing
from studies import CONFIGS

CONFIG = CONFIGS / "size_pump.yaml"
BEST = 0.01  # share of the designs that count as the best
LPM = 6e4


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Sweep the bounds of a sizing task at 20 Hz, print what the best have in common, leave table and picture."""
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
    sound = table[table["status"] == 0]
    goal = sound["mean_flow"] * sound["overall_efficiency"]
    best = sound.loc[goal.nlargest(max(5, int(BEST * len(sound)))).index]
    options.out.mkdir(parents=True, exist_ok=True)
    table.to_parquet(options.out / "table.parquet")
    picture(task, sound, best).savefig(options.out / "design_space.png", dpi=130)
    for axis in task.variables:
        low, high = best[axis.name].quantile([0.1, 0.9])
        print(f"{axis.name}: the best lie in {low:.3g} … {high:.3g} of {axis.low:.3g} … {axis.high:.3g} (SI)")
    print(f"designs={options.points} sound={len(sound)} best_flow_lpm={best['mean_flow'].max() * LPM:.3f} "
          f"best_efficiency={sound['overall_efficiency'].max():.3f}")  # fmt: skip
    return {"sound": len(sound) / options.points}


def picture(task, sound: pd.DataFrame, best: pd.DataFrame):
    """Flow against efficiency of all designs, and where the best lie within the bounds."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2)
    some = sound.sample(min(len(sound), 4000), random_state=0)
    dots = left.scatter(some["mean_flow"] * LPM, 100 * some["overall_efficiency"], c=1e3 * some["piston_diameter"], s=5,
                        cmap="viridis", linewidths=0)  # fmt: skip
    left.scatter(best["mean_flow"] * LPM, 100 * best["overall_efficiency"], s=12, facecolors="none",
                 edgecolors="#d1490c", linewidths=0.8, label="best 1 % in flow × efficiency")  # fmt: skip
    left.set(xlabel="mean flow, L/min", ylabel="overall efficiency, %")
    left.legend(frameon=False, fontsize=8.5)
    figure.colorbar(dots, ax=left, pad=0.01, label="piston diameter, mm").outline.set_visible(False)
    shares = [np.log(best[a.name] / a.low) / np.log(a.high / a.low) if a.log
              else (best[a.name] - a.low) / (a.high - a.low) for a in task.variables]  # fmt: skip
    right.boxplot(shares, orientation="horizontal", widths=0.5, showfliers=False,
                  medianprops={"color": "#d1490c", "lw": 2})  # fmt: skip
    right.set_yticks(range(1, len(task.variables) + 1), [a.name.replace("_", " ") for a in task.variables])
    right.set(xlim=(0, 1), xlabel="place of the best within the bounds, 0 … 1")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    figure.suptitle(f"{len(sound):,} pumps at 20 Hz", x=0.01, ha="left", fontsize=11)
    return figure


if __name__ == "__main__":
    main()
