"""Pareto front of flow and efficiency of sized pumps, from one configuration.

    python -m studies.sizing.pareto_front [--designs 8] [--out FOLDER]
"""

import argparse
import dataclasses
from pathlib import Path

from rich.console import Console

from edhas_jax.design.sizing.config import load_sizing
from edhas_jax.tasks.size import size
from studies import CONFIGS

CONFIG = CONFIGS / "size_pump.yaml"


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Size along the front, print it, write configurations and a picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--config", type=Path, default=CONFIG)
    parser.add_argument("--designs", type=int, default=8)
    parser.add_argument("--starts", type=int, default=6)
    parser.add_argument("--iterations", type=int, default=15)
    parser.add_argument("--out", type=Path, default=Path("runs/pareto_front"))
    options = parser.parse_args(arguments)
    task = dataclasses.replace(load_sizing(options.config), front=options.designs, starts=options.starts,
                               iterations=options.iterations)  # fmt: skip
    with Console().status("sizing") as status:
        result = size(task, on_progress=lambda what, share: status.update(what))
    result.save(options.out, overwrite=True)
    metrics = list(task.weights)
    for k, sized in enumerate(result.machines):
        values = "  ".join(f"{m} {sized.metrics[m].mean():.4g}" for m in metrics)
        print(f"{k + 1}: {values}  limited by {'; '.join(sized.active)}")
    first, last = (result.machines[k].metrics[metrics[0]].mean() for k in (0, -1))
    print(f"designs={len(result.machines)} flow_ratio={first / last:.3g} seconds={result.seconds:.0f}")
    return {"flow_ratio": first / last}


if __name__ == "__main__":
    main()
