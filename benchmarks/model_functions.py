"""What `edhas_jax.model` adds to the engine: metrics and their gradient in `jax.vmap`, compared with direct calls.

    python benchmarks/model_functions.py [--sets N] [--steps N] [--rounds N]

The function and the engine take turns on the same parameter sets at the same steps per cycle, everything compiled
before, on the cores of this process; the best of the rounds counts. The last line sums up as key=value.
"""

import argparse
import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

import edhas_jax as edhas
from edhas_jax.core import runtime
from edhas_jax.design.batch.experiment_design import Axis, latin_hypercube
from edhas_jax.design.gradient.fixed_point import GradientSettings, periodic_state
from edhas_jax.design.gradient.forward import forward
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage

PUMP = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
RANGES = (
    Axis("piston_clearance", 5e-6, 40e-6), Axis("piston_diameter", 10e-3, 14e-3),
    Axis("valve_spring_rate", 100.0, 400.0), Axis("frequency", 8.0, 30.0),
)  # fmt: skip
METRIC = "mean_flow"


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--sets", type=int, default=10_000, help="parameter sets")
    options.add_argument("--steps", type=int, default=1024, help="time steps per cycle")
    options.add_argument("--rounds", type=int, default=3)
    options = options.parse_args()
    jax.config.update("jax_enable_x64", True)
    settings = GradientSettings(options.steps)
    model = edhas.model(PUMP, settings)
    sets = latin_hypercube(RANGES, options.sets)
    names = sorted(sets)

    def flow(parameters):
        return model.metrics(parameters, [METRIC])[METRIC]

    batch = {n: jnp.asarray(sets[n]) for n in names}
    columns = {n: sets[n] for n in names}
    ways = {
        "metrics": (
            jax.jit(jax.vmap(flow)), lambda: periodic_state(PUMP, columns, settings).metrics[METRIC],
        ),
        "gradient": (
            jax.jit(jax.vmap(jax.value_and_grad(flow))), lambda: forward(PUMP, columns, names, [METRIC], settings),
        ),
    }  # fmt: skip
    print(f"{options.sets:,} sets of {len(names)} parameters, {options.steps} steps per cycle, {runtime.cores()} cores")
    print(f"{'':10}{'through JAX, s':>16}{'engine, s':>12}{'ratio':>8}")
    found = {}
    for what, (function, direct) in ways.items():
        seconds = alternating([lambda f=function: jax.block_until_ready(f(batch)), direct], options.rounds)
        found |= {f"{what}_s": seconds[0], f"{what}_engine_s": seconds[1], f"{what}_ratio": seconds[0] / seconds[1]}
        print(f"{what:10}{seconds[0]:16.2f}{seconds[1]:12.2f}{seconds[0] / seconds[1]:8.2f}", flush=True)
    one = {n: float(v[0]) for n, v in sets.items()}
    compiled = jax.jit(jax.value_and_grad(flow))
    found["one_gradient_ms"] = 1e3 * alternating([lambda: jax.block_until_ready(compiled(one))], options.rounds)[0]
    print(f"value and gradient of one set: {found['one_gradient_ms']:.0f} ms")
    print(f"sets={options.sets} " + " ".join(f"{name}={value:.4g}" for name, value in found.items()))


def alternating(ways: list[Callable], rounds: int) -> list[float]:
    """The least seconds of each way, which take turns; the first round only compiles."""
    best = np.full(len(ways), np.inf)
    for number in range(rounds + 1):
        for k, way in enumerate(ways):
            began = time.perf_counter()
            way()
            if number:
                best[k] = min(best[k], time.perf_counter() - began)
    return best.tolist()


if __name__ == "__main__":
    main()
