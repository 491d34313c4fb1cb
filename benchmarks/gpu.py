"""The loop kernels on a GPU: design-steps per second by batch, against XLA's scan and the processor of this machine.

    python benchmarks/gpu.py [--largest N] [--steps N] [--peer-designs N]

Without a GPU no speed is measured. What can be said all the same is printed first, on every machine: for each kernel
and architecture the registers, the bytes that a thread spills, the instructions of a step (by NVIDIA's ptxas and
nvdisasm, where they are installed: pip install nvidia-cuda-nvcc-cu12 nvidia-cuda-nvdisasm), and the seconds to write
and to assemble it. The bound is the issue bound: every issue slot of the GPU filled with instructions of a step.
Whole tasks follow (benchmarks/gpu_tasks.py); at the end cubie and diffrax run on the same GPU, where they are installed
(benchmarks/gpu_peers.py). The last line sums up as key=value.
"""

import argparse
import dataclasses
import math
import sys
import time
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np

sys.path[:0] = [str(Path(__file__).parent.parent), str(Path(__file__).parent)]

from edhas_jax.compiler import engines  # noqa: E402
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver, Device  # noqa: E402
from edhas_jax.compiler.gpu.device_kernel import MOST_SPILLED_BYTES, REGISTERS, DeviceKernel  # noqa: E402
from edhas_jax.compiler.gpu.ptx import ptx  # noqa: E402
from edhas_jax.compiler.gpu.rates import issue_rate  # noqa: E402
from edhas_jax.compiler.loop_engine import Loop  # noqa: E402
from edhas_jax.compiler.native_engine import processor_problem  # noqa: E402
from edhas_jax.compiler.xla_engine import XlaLoop  # noqa: E402
from edhas_jax.core import runtime  # noqa: E402
from tests.support.fake_cuda import FakeCuda  # noqa: E402
from tests.support.loop_bodies import NAMES, body_of, pump_lanes  # noqa: E402
from tests.support.ptx_assembler import MISSING, Assembled, assembled, loop_instructions, tool  # noqa: E402

BATCHES = (1_000, 4_000, 16_000, 65_000, 262_000, 1_000_000)
ARCHITECTURES = ("sm_80", "sm_90", "sm_100")
KERNELS = [(name, dtype) for name in NAMES for dtype in ("float32", "float64")
           if name in ("pump", "system") or dtype == "float64"]  # fmt: skip
H100 = Device(0, "H100 SXM", (9, 0), 132, 1.98e9)  # for a bound where there is no GPU


def main() -> None:
    """Run the benchmark and print its tables, then its headline figures as `key=value` pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=int, default=BATCHES[-1], help="leave out batches above this one")
    parser.add_argument("--steps", type=int, default=2048, help="steps of a measurement")
    parser.add_argument("--peer-designs", type=int, default=16384, help="designs that cubie and diffrax run; 0: none")
    options = parser.parse_args()
    import gpu_tasks  # in this folder

    headline = kernels()
    print()
    headline |= gpu_tasks.tasks(min(options.largest, 100_000))
    problem = engines.GPU.unavailable()
    if problem:
        print(f"\nno speed was measured, neither of the kernels nor of cubie and diffrax: {problem}")
        headline |= {"gpu": "none", "measured": 0}
    else:
        headline |= speeds([b for b in BATCHES if b <= options.largest], options.steps)
        if options.peer_designs:
            import gpu_peers  # in this folder; not before, because it changes settings of JAX

            print(f"\n{options.peer_designs} designs, three cycles, mean flow within 0.1 %")
            headline |= gpu_peers.factors(options.peer_designs)
    print(" ".join(f"{name}={value}" for name, value in headline.items()))


class Compiled(NamedTuple):
    """A kernel on an architecture, with the limit of registers that the package would take there."""

    limit: int
    found: Assembled
    seconds: float


def kernels() -> dict[str, object]:
    """Print the table of kernels and return the headline figures, which are those of the pump bench on sm_90."""
    headline: dict[str, object] = {}
    print(f"{'kernel':<24}{'dtype':<9}{'constants':>9}{'trace s':>9}{'PTX s':>7}", end="")
    print(f"  {'arch':<8}{'limit':>6}{'registers':>10}{'stored B':>9}{'loaded B':>9}{'ptxas s':>9}"
          f"{'per step':>9}{'FMA':>6}{'MUFU':>6}")  # fmt: skip
    for name, dtype in KERNELS:
        body = dataclasses.replace(body_of(name, dtype), dtype=dtype)
        begin = time.perf_counter()
        kernel = DeviceKernel(body, CudaDriver(FakeCuda()), backwards=name == "reverse")
        traced = time.perf_counter()
        text = ptx(kernel.text.kernel, "sm_80")
        written = time.perf_counter()
        head = f"{name:<24}{dtype:<9}{kernel.text.count:9}{traced - begin:9.2f}{written - traced:7.2f}"
        if tool("ptxas") is None:
            print(f"{head}  {MISSING}")
            continue
        for architecture in ARCHITECTURES:
            limit, found, seconds = compiled(text, architecture)
            step = loop_instructions(found.code) if tool("nvdisasm") else {}
            numbers = f"{found.registers:10}{found.spilled[0]:9}{found.spilled[1]:9}{seconds:9.2f}"
            row = f"  {architecture:<8}{limit:6}{numbers}"
            counts = [step.get(key, math.nan) for key in ("all", "fma", "mufu")]
            print(head + row + "".join(f"{c:{w}.0f}" for c, w in zip(counts, (9, 6, 6), strict=True)), flush=True)
            head = " " * len(head)
            if name == "pump" and architecture == "sm_90":
                headline |= {f"registers_{dtype}": found.registers, f"spilled_{dtype}": max(found.spilled)}
                if step:
                    headline[f"instructions_{dtype}"] = step["all"]
                    headline[f"bound_h100_{dtype}"] = f"{bound(H100, dtype, step['all'], step['double']):.3g}"
    return headline


def compiled(text: str, architecture: str) -> Compiled:
    """A kernel as the launcher would have it compiled: with as few registers as spill little."""
    for limit in REGISTERS:
        begin = time.perf_counter()
        found = assembled(text, architecture, limit)
        seconds = time.perf_counter() - begin
        if found.local_bytes <= MOST_SPILLED_BYTES:
            break
    return Compiled(limit, found, seconds)


def bound(device: Device, dtype: str, instructions: float, double: float) -> float:
    """Design-steps per second with every issue slot filled; float64 instructions take as many as the units allow."""
    slots = device.multiprocessors * device.clock * issue_rate(device, True)
    if dtype == "float32":
        return slots / instructions
    factor = issue_rate(device, True) / issue_rate(device, False)
    return slots / max(instructions, double * factor)


def speeds(batches: list[int], steps: int) -> dict[str, object]:
    """Measure the step of the pump bench with its metrics; the best rates in float32."""
    devices = engines.GPU.devices()
    headline: dict[str, object] = {"gpu": devices[0].name.replace(" ", "_"), "measured": 1}
    print(f"\n{engines.GPU.device_names()}; {runtime.cores()} cores; {steps} steps a call, host arrays, with metrics")
    print(f"{'dtype':<9}{'batch':>9}{'GPU kernel':>12}{'of bound':>9}{'XLA scan':>12}{'processor':>12}  design-steps/s")
    for dtype in ("float32", "float64"):
        body, best = body_of("pump", dtype), {}
        gpu = engines.GPU.compile(body)
        share = bound_of(gpu.kernel, devices, dtype)
        loops: dict[str, Loop | None] = {"GPU kernel": gpu, "XLA scan": None, "processor": None}
        if runtime.platform() in ("gpu", "cuda"):
            loops["XLA scan"] = XlaLoop(body)
        # also where JAX has the GPU, so that the native engine does not serve: all three are measured in one run
        if not processor_problem():
            loops["processor"] = engines.NATIVE.compile(body)
        for batch in batches:
            rates = {n: math.nan if loop is None else rate(loop, batch, dtype, steps) for n, loop in loops.items()}
            best = {n: float(np.fmax(best.get(n, math.nan), r)) for n, r in rates.items()}
            fastest = rates["GPU kernel"]
            print(f"{dtype:<9}{batch:9}{fastest:12.3g}{fastest / share:9.2f}{rates['XLA scan']:12.3g}"
                  f"{rates['processor']:12.3g}", flush=True)  # fmt: skip
        headline |= {f"gpu_{dtype}": f"{best['GPU kernel']:.3g}", f"bound_{dtype}": f"{share:.3g}",
                     f"over_processor_{dtype}": f"{best['GPU kernel'] / best['processor']:.3g}",
                     f"over_xla_{dtype}": f"{best['GPU kernel'] / best['XLA scan']:.3g}"}  # fmt: skip
    return headline


def bound_of(kernel: DeviceKernel, devices: list[Device], dtype: str) -> float:
    """Design-steps per second if every issue slot of the GPUs were used; NaN without ptxas or nvdisasm."""
    if not (tool("ptxas") and tool("nvdisasm")):
        return math.nan
    text, total = ptx(kernel.text.kernel, "sm_80"), 0.0
    for device in devices:
        architecture = "sm_{}{}".format(*device.capability)
        step = loop_instructions(compiled(text, architecture).found.code)
        total += bound(device, dtype, step["all"], step["double"])
    return total


def rate(loop: Loop, batch: int, dtype: str, steps: int, rounds: int = 3) -> float:
    """Design-steps per second, the best of some rounds; the first, which compiles, does not count."""
    carry, lane, uniform = pump_lanes(batch, dtype)
    carry, lane = (jax.tree.map(lambda leaf: np.asarray(leaf, dtype), tree) for tree in (carry, lane))
    loop(carry, lane, uniform, 0, 16, runtime.cores())
    seconds = []
    for _ in range(rounds):
        begin = time.perf_counter()
        loop(carry, lane, uniform, 0, steps, runtime.cores())
        seconds.append(time.perf_counter() - begin)
    return batch * steps / min(seconds)


if __name__ == "__main__":
    main()
