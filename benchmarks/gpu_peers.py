"""The kernel on a GPU beside cubie and diffrax on the same GPU, on the pump bench and at the same accuracy.

    python benchmarks/gpu_peers.py [--designs N] [--tiny]

As in benchmarks/peers.py each program simulates three cycles of 0.1 s and has to give the mean flow of the third within
0.1 % of a tight reference; each takes the loosest tolerance, or the largest step, with which the worst design does.
What counts is simulated seconds times designs per second of wall clock, with arguments and results on the host.

- The package: as `edhas_jax.design.batch.batch.run_designs` runs the designs with `EDHAS_ENGINE=gpu`.
- diffrax: adaptive Kvaerno methods under `jit` and `vmap`; it needs JAX for the GPU (pip install "jax[cuda12]").
- cubie (pip install "cubie[cuda12]"): an adaptive Rosenbrock and an adaptive Radau method in both precisions. Its users
  write a model as equations; those of this bench, some three hundred, are written out of the package's own translation
  of its right side.

With `--tiny` two designs run without a GPU, to see that everything works: the package on the processor, diffrax with
JAX on the processor, cubie in the simulator of its compiler for a fraction of a cycle. The rates of such a run mean
nothing. The last line sums up as key=value.
"""

import argparse
import functools
import importlib.util
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import c_loop
import jax
import numpy as np
import peers
from engine_choice import with_engine
from peers import ALLOWED, CYCLES, END, FLOW, FREQUENCY, Row, best_of, start, worst

from edhas_jax.compiler import engines
from edhas_jax.compiler.scalar_ir import Program
from edhas_jax.core import runtime
from edhas_jax.design.batch.batch import BatchSettings, run_designs

METHODS = ("rodas3p", "radau")  # of cubie: Rosenbrock of order 3, Radau IIA of order 5
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
REFERENCE_DESIGNS = 64  # whose mean flow is compared
TINY_SPAN = 5e-4  # [s], which the simulator of cubie takes seconds for
SMALLEST_STEP = 1e-9  # [s], that cubie may take: contacts need short ones


def main() -> None:
    """Run the comparison and print its rows, then how much faster the package is as `key=value` pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--designs", type=int, default=16384)
    parser.add_argument("--tiny", action="store_true", help="two designs, without a GPU: shows only that it works")
    options = parser.parse_args()
    if options.tiny:
        os.environ["NUMBA_ENABLE_CUDASIM"] = "1"  # read by cubie's compiler when it is imported
    headline = factors(2 if options.tiny else options.designs, options.tiny)
    print(" ".join(f"{name}={value}" for name, value in headline.items()))


def factors(count: int, tiny: bool = False) -> dict[str, str]:
    """Run the comparison; by how much the package is faster than each of the others, or why nothing is said."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ.setdefault("CUBIE_CACHE_DIR", folder)  # else cubie leaves a folder where it is run
        rows = compare(count, tiny)
    headline = {}
    for name in ("cubie", "diffrax"):
        if {"package", name} <= rows.keys():
            headline[f"over_{name}"] = "ran" if tiny else f"{rows['package'].rate / rows[name].rate:.3g}"
        else:
            headline[f"over_{name}"] = "skipped"
    return headline


def compare(count: int, tiny: bool) -> dict[str, Row]:
    """The row of each contestant that can run here, by name; a sentence is printed for each that cannot."""
    values = c_loop.designs(count, "float64")
    values["frequency"] = np.full(count, FREQUENCY)
    contestants = {"package": in_package, "diffrax": in_diffrax, "cubie": in_cubie}
    reasons = {name: "" if tiny else engines.GPU.unavailable() for name in contestants}
    for name in ("diffrax", "cubie"):
        if not importlib.util.find_spec(name):
            reasons[name] = f"{name} is not installed"
    if not reasons["diffrax"] and not tiny and runtime.platform() not in ("gpu", "cuda"):
        reasons["diffrax"] = 'JAX sees no GPU (pip install "jax[cuda12]")'
    rows: dict[str, Row] = {}
    tight = None
    for name, contestant in contestants.items():
        if reasons[name]:
            print(f"  {name} was not run: {reasons[name]}", flush=True)
            continue
        if tight is None:
            tight = reference({n: v[:REFERENCE_DESIGNS] for n, v in values.items()}, 4096 if tiny else 131072)
        rows[name] = contestant(values, tight, tiny)
        row = rows[name]
        print(f"  {name:<9}{row.setting:<40}error {row.error:8.1e}{row.rate:12.4g} s·designs/s", flush=True)
    return rows


def reference(values: dict, steps: int) -> np.ndarray:
    """The mean flow of each design in the third cycle, by the package in float64 with so many steps a cycle."""
    settings = BatchSettings(step=1.0 / (FREQUENCY * steps), tolerance=-1.0, max_cycles=CYCLES)
    # the processor, unless JAX has a GPU: then the native engine leaves everything to it
    with with_engine("gpu" if engines.NATIVE.unavailable() else "native"):
        return run_designs(c_loop.bench_machine(), values, settings)["mean_flow"]


def in_package(values: dict, tight: np.ndarray, tiny: bool) -> Row:
    """The batch engine at the largest step and in the precision that serve; a GPU counts as a whole."""
    with with_engine("native" if tiny else "gpu"):
        return peers.package(values, tight, 1)


def in_diffrax(values: dict, tight: np.ndarray, tiny: bool) -> Row:
    """`peers.diffrax_worker` in a process of its own, with all cores and on the GPU if JAX has one."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "diffrax.npz"
        np.savez(file, tight=tight, **values)
        command = [sys.executable, peers.__file__, "--diffrax", str(file)]
        out = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    return Row(*json.loads(out.splitlines()[-1]))


def in_cubie(values: dict, tight: np.ndarray, tiny: bool) -> Row:
    """The better of its methods and precisions; in the tiny run a fraction of a cycle, without an error."""
    rows = []
    span = TINY_SPAN if tiny else END
    for dtype in (np.float32, np.float64):
        solve = functools.partial(cubie_solver(dtype), values, span)
        for method in METHODS:
            for tolerance in TOLERANCES:
                call = functools.partial(solve, method, tolerance)
                error = math.nan if tiny else worst(call()[: len(tight)], tight)
                if tiny or error <= ALLOWED:
                    flow, took = best_of(call, 0.0 if tiny else 1.0)
                    if not np.isfinite(flow).all():
                        raise RuntimeError(f"cubie's {method} gives no numbers")
                    rate = span * len(values["frequency"]) / took
                    rows.append(Row("cubie", f"{method}, {np.dtype(dtype)}, rtol {tolerance:g}", error, rate))
                    break
    return max(rows, key=lambda row: row.rate, default=Row("cubie", "none serves", math.inf, math.nan))


def cubie_solver(dtype):
    """`solve(values, span, method, tolerance)`: the mean flow of designs in the last third of a time from rest on."""
    from cubie import Solver, create_ODE_system

    equations, states, parameters = model()
    system = create_ODE_system(
        equations, precision=dtype, states=states, parameters=dict.fromkeys(parameters, 1.0), name="pump_bench",
        swept_parameters=list(parameters),
    )  # fmt: skip

    @functools.cache
    def solver(method: str, tolerance: float, span: float) -> Solver:
        return Solver(
            system, algorithm=method, rtol=tolerance, atol=tolerance, dt_min=SMALLEST_STEP, save_variables=["z_flow"],
            output_types=["state"], save_every=span / CYCLES, time_logging_level=None,
        )  # fmt: skip

    def solve(values: dict, span: float, method: str, tolerance: float) -> np.ndarray:
        count = len(values["frequency"])
        result = solver(method, tolerance, span).solve(
            {n: np.full(count, v, dtype) for n, v in states.items()},
            {n: values[of].astype(dtype) for n, of in parameters.items()},
            duration=span, grid_type="verbatim", fix_constant_parameters=False,
        )  # fmt: skip
        volume = np.asarray(result.as_numpy["time_domain_array"], float)[:, 0, :] * sizes()[FLOW]
        return (volume[CYCLES] - volume[CYCLES - 1]) * CYCLES / span

    return solve


def sizes() -> dict[str, float]:
    """The size of each state, by which it is divided; the volume delivered last."""
    return dict(zip([*sorted(start()), FLOW], peers.scales(), strict=True))


def scaled_rates(p, y, t) -> dict:
    """The rates of the states divided by their sizes, from such states."""
    size = sizes()
    found = peers.right_side(p, {n: y[n] * size[n] for n in start()}, t)
    return {n: found[n] / s for n, s in size.items()}


# the operations of a program as SymPy reads them
_TEXT = {
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "neg": "-{}", "reciprocal": "1.0 / {}",
    "sqrt": "sqrt({})", "rsqrt": "1.0 / sqrt({})", "inverse_root4": "1.0 / sqrt(sqrt({}))", "abs": "Abs({})",
    "exp": "exp({})", "log1p": "log(1.0 + {})", "sin": "sin({})", "cos": "cos({})", "max": "Max({}, {})",
    "min": "Min({}, {})", "gt": "({} > {})", "ge": "({} >= {})", "eq": "Eq({}, {})", "ne": "Ne({}, {})",
    "not": "Not({})", "and": "And({}, {})", "or": "Or({}, {})", "select": "Piecewise(({1}, {0}), ({2}, True))",
}  # fmt: skip


def model(program: Program | None = None) -> tuple[list[str], dict[str, float], dict[str, str]]:
    """The bench as cubie takes it.

    Returns:
        The equations in order; the initial value of each state, in its size; the parameter of the bench that each
        parameter of the equations stands for.
    """
    program = program or peers.program_of(scaled_rates)
    states = {n: f"z{i}" for i, n in enumerate(sorted(start()))} | {FLOW: "z_flow"}
    parameters = {f"p{i}": n for i, n in enumerate(c_loop.VARIED)}
    inputs = {f"['y'][{n!r}]": z for n, z in states.items()} | {"['t']": "t"}
    inputs |= {f"['p'][{n!r}]": p for p, n in parameters.items()}
    names: dict[int, str] = {}
    equations = []
    for i in program.schedule():
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = inputs[args[0]]
        elif op in ("const", "bool"):
            names[i] = f"({args[0]!r})"
        else:
            text = _TEXT[op].format(*(names[k] for k in args))
            if program.is_boolean(i):
                names[i] = text
            else:
                names[i] = f"a{i}"
                equations.append(f"a{i} = {text}")
    equations += [f"d{z} = {names[program.outputs[n]]}" for n, z in states.items()]
    size, at_rest = sizes(), start() | {FLOW: 0.0}
    initial = {z: float(at_rest[n]) / size[n] for n, z in states.items()}
    return equations, initial, parameters


jax.config.update("jax_enable_x64", True)  # for what this benchmark computes by itself


if __name__ == "__main__":
    main()
