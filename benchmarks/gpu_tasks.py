"""Whole tasks on a GPU: many pumps to their periodic state, agreement with the processor, and derivatives.

    python benchmarks/gpu_tasks.py [--designs N]

Printed are the seconds in which so many pump benches become periodic in float32 (the second of two runs), the largest
difference of their mean flow from the processor's, whether another order of the designs gives the same bits, and the
time of a cycle with the derivative in one direction relative to a cycle without, in float64. On every machine,
with a GPU or without, it first tells the seconds that such a batch takes beside its kernels: what the processor does
for it. The last line sums up as key=value.
"""

import argparse
import sys
import time
from pathlib import Path
from unittest import mock

import jax
import numpy as np

sys.path.insert(0, str(Path(__file__).parent.parent))

from benchmarks.engine_choice import with_engine  # noqa: E402
from edhas_jax.compiler import engines  # noqa: E402
from edhas_jax.core import runtime  # noqa: E402
from edhas_jax.design.batch import batch, periodic_solver  # noqa: E402
from edhas_jax.design.batch.batch import BatchSettings, run_designs  # noqa: E402
from edhas_jax.simulation import loop_cache  # noqa: E402
from edhas_jax.simulation.run_settings import Precision  # noqa: E402
from tests.support.loop_bodies import VARIED, body_of, pump, pump_lanes  # noqa: E402

SETTINGS = BatchSettings(step=5e-5, max_cycles=4, precision=Precision.FLOAT32)
COMPARED = 256  # designs that the processor runs too
STEPS = 2048  # of the cycle that is timed with and without a derivative


def main() -> None:
    """Print the figures of the tasks, then all of them as `key=value` pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--designs", type=int, default=100_000)
    headline = tasks(parser.parse_args().designs)
    print(" ".join(f"{name}={value}" for name, value in headline.items()))


def tasks(count: int) -> dict[str, str]:
    """The figures; those of a GPU only where there is one."""
    seconds = beside_kernels(count)
    cores = f"{runtime.cores()} {'core' if runtime.cores() == 1 else 'cores'}"
    print(f"{count:,} designs, {SETTINGS.max_cycles} cycles, without their kernels: {seconds:.3f} s on {cores}")
    found = {"beside_kernels_s": f"{seconds:.3f}"}
    if problem := engines.GPU.unavailable():
        print(f"nothing was measured on a GPU: {problem}")
        return found
    found |= to_periodic(count) | derivative(min(count, 65_536))
    print(", ".join(f"{name} {value}" for name, value in found.items()), flush=True)
    return found


def designs(count: int) -> dict[str, np.ndarray]:
    """Pump benches at 10 Hz whose other parameters differ by up to 10 %."""
    return dict(pump_lanes(count, "float64").lane) | {"frequency": np.full(count, 10.0)}


class NoSteps:
    """A loop that leaves its lanes where they are, in place of one on a GPU."""

    lanes, engine = 1_000_000, "none"

    def with_vectors(self, vectors: int) -> "NoSteps":
        """The loop itself."""
        return self

    def __call__(self, carry, *_) -> list[np.ndarray]:
        """The carry, copied as from a GPU."""
        leaves = jax.tree.leaves(carry)
        return [np.array(np.broadcast_to(leaf, len(leaves[0]))) for leaf in leaves]


def beside_kernels(count: int) -> float:
    """The shortest time [s] of a batch whose kernels take none."""
    values, seconds = designs(count), []
    loop_cache._made.cache_clear()
    try:
        with (
            mock.patch.object(periodic_solver, "compile_loop", lambda body: NoSteps()),
            mock.patch.object(batch, "many_lanes", lambda *_: True),
        ):
            for _ in range(4):
                seconds.append(timed(lambda: run_designs(pump(), values, SETTINGS))[0])
    finally:
        loop_cache._made.cache_clear()  # no task may find the loop without steps
    return min(seconds)


def to_periodic(count: int) -> dict[str, str]:
    """A batch on the GPU: seconds, difference from the processor, and whether the order of the designs matters."""
    values = designs(count)
    with with_engine("gpu"):
        run_designs(pump(), values, SETTINGS)  # compiles
        seconds, found = timed(lambda: run_designs(pump(), values, SETTINGS))
        order = np.random.default_rng(0).permutation(count)
        again = run_designs(pump(), {n: v[order] for n, v in values.items()}, SETTINGS)
    same = all(np.array_equal(again[n], found[n][order], equal_nan=True) for n in found)
    headline = {"periodic_s": f"{seconds:.3g}", "same_bits_in_any_order": str(int(same))}
    if not engines.NATIVE.unavailable():
        few = {n: v[:COMPARED] for n, v in values.items()}
        with with_engine("native"):
            right = run_designs(pump(), few, SETTINGS)["mean_flow"]
        headline["mean_flow_differs"] = f"{np.nanmax(np.abs(found['mean_flow'][:COMPARED] / right - 1.0)):.2g}"
    return headline


def derivative(count: int) -> dict[str, str]:
    """A cycle with one tangent relative to one without, in float64."""
    carry, lane, uniform = pump_lanes(count, "float64")
    plain, tangent = (engines.GPU.compile(body_of(name, "float64")) for name in ("pump", "forward, 1 direction"))
    state, sums = carry
    tangents = jax.tree.map(lambda _: np.zeros(count), tangent.body.carry[1])
    seeds = {n: np.full(count, float(n == VARIED[0])) for n in VARIED}
    machine, steps, _ = uniform
    runs = {
        "plain": lambda: plain(carry, lane, uniform, 0, STEPS),
        "tangent": lambda: tangent((carry, tangents), (lane, seeds), (machine, steps), 0, STEPS),
    }
    seconds = {}
    for name, run in runs.items():
        run()
        seconds[name] = min(timed(run)[0] for _ in range(3))
    return {"forward_over_plain": f"{seconds['tangent'] / seconds['plain']:.3g}"}


def timed(call) -> tuple[float, object]:
    """Seconds of a call, and its result."""
    begin = time.perf_counter()
    result = call()
    return time.perf_counter() - begin, result


if __name__ == "__main__":
    main()
