"""What is a robust design worth? Nominal against robust sizing, both as they would come off the machine tools.

    python -m studies.sizing.robust_design [--machines 10000] [--out FOLDER]

Draws machines of both designs from the tolerances and shows the two distributions in one picture. The last line sums up
as key=value: the share of machines that keep every limit, and the objective that 95 % of the machines reach.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from rich.console import Console

from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.sizing.config import SizingTask, load_sizing
from edhas_jax.design.sizing.optimiser import FEASIBILITY_TOLERANCE
from edhas_jax.design.sizing.size import size
from edhas_jax.machine.parameters import get_parameter
from studies import CONFIGS

CONFIG = CONFIGS / "size_robust.yaml"
COLOURS = {"nominal": "#6e7781", "robust": "#d1490c"}


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Size twice, draw machines, print shares, leave a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--machines", type=int, default=10_000)
    parser.add_argument("--starts", type=int, default=8)
    parser.add_argument("--iterations", type=int, default=15)
    parser.add_argument("--out", type=Path, default=Path("runs/robust_design"))
    options = parser.parse_args(arguments)
    robust = load_sizing(options.config)
    robust = dataclasses.replace(robust, starts=options.starts, iterations=options.iterations)
    nominal = dataclasses.replace(robust, robust=None, tolerances=())
    console = Console(highlight=False)
    drawn = {}
    for name, task in (("nominal", nominal), ("robust", robust)):
        with console.status(f"sizing, {name}"):
            sized = size(task).machines[0]
        told = ", ".join(f"{n} {v:.4g}" for n, v in sized.design.items())
        console.print(f"{name}: {told}; limited by {'; '.join(sized.active)}")
        with console.status(f"drawing {options.machines:,} machines"):
            drawn[name] = draw(robust, sized.design, options.machines)
    options.out.mkdir(parents=True, exist_ok=True)
    picture(robust, drawn).savefig(options.out / "robust.png", dpi=130)
    summary = {}
    for name, got in drawn.items():
        summary[f"{name}_kept"] = float(np.mean(kept(robust, got)))
        summary[f"{name}_failed"] = float(np.mean(~np.isfinite(got["objective"])))
        summary[f"{name}_low_objective"] = float(np.quantile(np.nan_to_num(got["objective"], nan=-np.inf), 0.05))
    print(" ".join(f"{n}={v:.4g}" for n, v in summary.items()))
    return summary


def draw(task: SizingTask, design: dict[str, float], count: int) -> dict[str, np.ndarray]:
    """Metrics of machines of a design, every tolerance spread evenly; per machine the worst of the points."""
    rng = np.random.default_rng(1)
    table = {n: np.full(count, v) for n, v in design.items()}
    for tolerance in task.tolerances:
        stands = float(get_parameter(task.machine, tolerance.name))
        base = table.get(tolerance.name, np.full(count, stands))
        table[tolerance.name] = np.array(
            [tolerance.apply(v, s) for v, s in zip(base, rng.random(count), strict=True)]
        )
    cases = task.operating_points()
    points = len(next(iter(cases.values())))
    table = {n: np.repeat(v, points) for n, v in table.items()} | {n: np.tile(v, count) for n, v in cases.items()}
    got = run_designs(task.machine, table, task.settings)
    out = {limit.metric: got[limit.metric].reshape(count, points).max(axis=1) for limit in task.constraints}
    out["objective"] = sum(w * np.log(got[m]).reshape(count, points).mean(axis=1) for m, w in task.weights.items())
    return out


def kept(task: SizingTask, got: dict[str, np.ndarray]) -> np.ndarray:
    """Which machines keep every limit, by the rule that the sizing itself has."""
    allowed = 1.0 + FEASIBILITY_TOLERANCE
    return np.all([got[limit.metric] <= limit.value * allowed for limit in task.constraints], axis=0)


def picture(task: SizingTask, drawn: dict[str, dict[str, np.ndarray]]):
    """Histograms of the objective and of the metrics that are limited, nominal and robust over each other."""
    from matplotlib.figure import Figure

    from edhas_jax.core.units import from_si
    from edhas_jax.simulation.metrics import METRICS

    near = [
        limit.metric for limit in task.constraints
        if max(np.nanmax(got[limit.metric]) for got in drawn.values()) > 0.8 * limit.value
    ]  # fmt: skip
    names = ["objective", *near]
    figure = Figure(figsize=(4.2 * len(names), 3.6), layout="constrained")
    best = max(np.nanmedian(got["objective"]) for got in drawn.values())
    for axes, name in zip(figure.subplots(1, len(names)), names, strict=True):
        for kind, got in drawn.items():
            values = 100 * np.expm1(got[name] - best) if name == "objective" else from_si(got[name], *METRICS[name][:2])
            values = values[np.isfinite(values)]  # a machine that fails keeps no limit
            share = f", {100 * np.mean(kept(task, got)):.0f} % keep all limits"
            axes.hist(values, bins=50, density=True, color=COLOURS[kind], alpha=0.55, label=kind + share)
        axes.set_yticks([])
        axes.set_ylabel("machines")
        axes.spines[["top", "right"]].set_visible(False)
        if name == "objective":
            axes.set_xlabel("flow × efficiency, % from the better median")
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(0, 1.35 * axes.get_ylim()[1])
        else:
            limit = next(limit for limit in task.constraints if limit.metric == name)
            at = from_si(limit.value, *METRICS[name][:2])
            axes.axvline(at, color="#1b1f24", lw=1.2)
            axes.annotate("limit", (at, 0.97), (4, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
                          fontsize=8, va="top")  # fmt: skip
            axes.set_xlabel(f"{name.replace('_', ' ')}, {METRICS[name][1]}")
    count = len(next(iter(drawn.values()))["objective"])
    figure.suptitle(f"{count:,} machines of each design, drawn from the tolerances", x=0.01, ha="left", fontsize=11)
    return figure


if __name__ == "__main__":
    main()
