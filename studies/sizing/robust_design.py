"""Nominal and robust sizing compared under manufacturing tolerances.

    python -m studies.sizing.robust_design [--machines 10000] [--out FOLDER]

Draws machines of both designs from the tolerances and shows both distributions in one picture. The last line has for
each design, as key=value, the share of machines that meet every limit, the share that fails, and the objective that
95 % of the machines reach.
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
BINS = 50  # classes of a histogram


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Size twice, draw machines from the tolerances, print shares, write a picture."""
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
    samples = {}
    for name, task in (("nominal", nominal), ("robust", robust)):
        with console.status(f"sizing, {name}"):
            sized = size(task).machines[0]
        design = ", ".join(f"{n} {v:.4g}" for n, v in sized.design.items())
        console.print(f"{name}: {design}; limited by {'; '.join(sized.active)}")
        with console.status(f"drawing {options.machines:,} machines"):
            samples[name] = simulate_machines(robust, sized.design, options.machines)
    options.out.mkdir(parents=True, exist_ok=True)
    draw_distributions(robust, samples).savefig(options.out / "robust.png", dpi=130)
    summary = {}
    for name, metrics in samples.items():
        objective = np.nan_to_num(metrics["objective"], nan=-np.inf)
        summary[f"{name}_kept"] = float(np.mean(meets_limits(robust, metrics)))
        summary[f"{name}_failed"] = float(np.mean(~np.isfinite(metrics["objective"])))
        summary[f"{name}_low_objective"] = float(np.quantile(objective, 0.05))
    print(" ".join(f"{n}={v:.4g}" for n, v in summary.items()))
    return summary


def simulate_machines(task: SizingTask, design: dict[str, float], count: int) -> dict[str, np.ndarray]:
    """Simulate machines of a design with tolerances drawn from uniform distributions.

    Args:
        task: the sizing task with tolerances, operating points and limits.
        design: nominal dimensions in SI, by name.
        count: number of machines.

    Returns:
        The largest value of each limited metric over the operating points in SI, and the objective, by name, each of
        shape (count,).
    """
    rng = np.random.default_rng(1)
    table = {n: np.full(count, v) for n, v in design.items()}
    for tolerance in task.tolerances:
        nominal = float(get_parameter(task.machine, tolerance.name))
        base = table.get(tolerance.name, np.full(count, nominal))
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


def meets_limits(task: SizingTask, metrics: dict[str, np.ndarray]) -> np.ndarray:
    """Whether each machine meets every limit within the tolerance of the sizing itself, shape (machines,)."""
    allowed = 1.0 + FEASIBILITY_TOLERANCE
    return np.all([metrics[limit.metric] <= limit.value * allowed for limit in task.constraints], axis=0)


def draw_distributions(task: SizingTask, samples: dict[str, dict[str, np.ndarray]]):
    """Draw histograms of the objective and of the metrics near their limits, nominal and robust design overlaid."""
    from matplotlib.figure import Figure

    from edhas_jax.core.units import from_si
    from edhas_jax.machine.metrics import METRICS

    near_limit = [
        limit.metric for limit in task.constraints
        if max(np.nanmax(metrics[limit.metric]) for metrics in samples.values()) > 0.8 * limit.value
    ]  # fmt: skip
    names = ["objective", *near_limit]
    figure = Figure(figsize=(4.2 * len(names), 3.6), layout="constrained")
    best = max(np.nanmedian(metrics["objective"]) for metrics in samples.values())
    for axes, name in zip(figure.subplots(1, len(names)), names, strict=True):
        drawn = {}
        for kind, metrics in samples.items():
            if name == "objective":
                values = 100 * np.expm1(metrics[name] - best)
            else:
                values = from_si(metrics[name], METRICS[name].unit, METRICS[name].display_unit)
            values = values[np.isfinite(values)]  # NaN: the simulation failed
            share = f", {100 * np.mean(meets_limits(task, metrics)):.0f} % meet all limits"
            drawn[kind + share] = values
        edges = np.histogram_bin_edges(np.concatenate([*drawn.values()]), BINS)
        for (label, values), colour in zip(drawn.items(), COLOURS.values(), strict=True):
            axes.hist(values, edges, color=colour, alpha=0.55, label=label)
        axes.set_ylabel(f"machines in each of {BINS} classes")
        axes.spines[["top", "right"]].set_visible(False)
        if name == "objective":
            axes.set_xlabel("flow × efficiency, % from the better median")
            axes.legend(frameon=False, fontsize=8, loc="upper left")
            axes.set_ylim(0, 1.35 * axes.get_ylim()[1])
        else:
            limit = next(limit for limit in task.constraints if limit.metric == name)
            at = from_si(limit.value, METRICS[name].unit, METRICS[name].display_unit)
            axes.axvline(at, color="#1b1f24", lw=1.2)
            axes.annotate("limit", (at, 0.97), (4, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
                          fontsize=8, va="top")  # fmt: skip
            axes.set_xlabel(f"{name.replace('_', ' ')}, {METRICS[name].display_unit}")
    count = len(next(iter(samples.values()))["objective"])
    figure.suptitle(f"{count:,} machines of each design, drawn from the tolerances", x=0.01, ha="left", fontsize=11)
    return figure


if __name__ == "__main__":
    main()
