"""The package beside what one would use instead, on the pump bench and at the same accuracy of the mean flow.

    python benchmarks/peers.py [--designs N] [--out FILE.csv]

Everybody simulates three cycles of 0.1 s, the first a soft start, and has to give the mean flow of the third within
0.1 % of a tight reference; each takes the loosest tolerance, or the largest step, with which the worst design does.
What counts is simulated seconds times designs per second of wall clock and core. SciPy gets right side and exact
Jacobian compiled by Numba and a pool of processes; Numba's loop and the C loop take the very step of the package.
numba, diffrax and g++ are optional (`pip install -e '.[bench]'`); what is missing is skipped.
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
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import NamedTuple

import c_loop
import jax
import jax.numpy as jnp
import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

from edhas_jax.compiler.derivative_graph import linearize
from edhas_jax.compiler.jaxpr_to_ir import trace_to_ir
from edhas_jax.compiler.scalar_ir import Dependence, Program
from edhas_jax.compiler.sparse_elimination import jacobian
from edhas_jax.design.batch.batch import BatchSettings, run_designs, steps_per_cycle
from edhas_jax.simulation.run_settings import Precision

jax.config.update("jax_enable_x64", True)  # for what this benchmark computes by itself

FREQUENCY = 10.0
CYCLES = 3
END = CYCLES / FREQUENCY
ALLOWED = 1e-3
DTYPES = ("float32", "float64")
STEPS = (100e-6, 70e-6, 50e-6, 35e-6, 25e-6, 18e-6, 12e-6, 9e-6)  # largest step; a cycle takes a whole number of them
TOLERANCES = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 1e-5, 1e-6, 1e-7)
REFERENCE_STEPS = 131072  # in a cycle
FEW = {"lsoda": 8, "radau": 4, "diffrax": 64, "numba": 64}  # designs that are enough to time the slow ones
FLOW = "outlet flow"  # the name of the sum that all of them keep


class Row(NamedTuple):
    """One contestant: what it needed, how wrong it was, simulated seconds × designs per second and core."""

    name: str
    setting: str
    error: float
    rate: float


def main() -> None:
    """Run the benchmark and print its table, then its headline figures as `key=value` pairs."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--designs", type=int, default=1024, help="for the package and the C loop")
    options.add_argument("--out", type=Path, help="write the table to this CSV file")
    options.add_argument("--diffrax", type=Path, help=argparse.SUPPRESS)
    options = options.parse_args()
    if options.diffrax:
        return diffrax_worker(options.diffrax)
    values = c_loop.designs(options.designs, "float64")
    values["frequency"] = np.full(options.designs, FREQUENCY)
    cores = len(os.sched_getaffinity(0))

    with tempfile.TemporaryDirectory() as folder:
        compiled = numba_module(Path(folder)) if importlib.util.find_spec("numba") else None
        tight = reference(values, compiled, cores)
        rows = [package(values, tight, cores)]
        report(rows[0])
        contestants = {
            "diffrax": lambda: in_diffrax(values, tight, Path(folder)),
            "lsoda": lambda: in_scipy("LSODA", values, tight, compiled, cores),
            "radau": lambda: in_scipy("Radau", values, tight, compiled, cores),
            "numba": lambda: in_numba(values, tight, compiled, cores),
            "c": lambda: in_c(values, tight, cores),
        }
        needed = {"diffrax": find("diffrax"), "c": c_loop.available()}
        for name, contestant in contestants.items():
            if needed.get(name, compiled is not None):
                rows.append(contestant())
                report(rows[-1])
            else:
                print(f"  {name:<9}not installed", flush=True)
    again = package(values, tight, cores)
    own = max(rows[0].rate, again.rate)
    table = pd.DataFrame(rows)
    table["factor"] = own / table["rate"]
    if options.out:
        table.to_csv(options.out, index=False)
    found = table.set_index("name")["factor"]
    print(" ".join(f"{n}={found[n]:.4g}" if n in found else f"{n}=not installed" for n in contestants))


def find(name: str) -> bool:
    """Whether a package is installed."""
    return importlib.util.find_spec(name) is not None


def report(row: Row) -> None:
    """One line of the table."""
    print(f"  {row.name:<9}{row.setting:<44}error {row.error:8.1e}{row.rate:12.4g} s·designs/(s·core)", flush=True)


def worst(flow: np.ndarray, tight: np.ndarray) -> float:
    """The largest relative error of the mean flow; infinite where there is none."""
    error = np.abs(flow / tight[: len(flow)] - 1.0)
    return float(np.where(np.isfinite(error), error, np.inf).max())


def best_of(call, least: float = 1.0) -> tuple:
    """The result of a call, and the shortest time it took in some runs."""
    best, spent, runs = math.inf, 0.0, 0
    while runs < 2 or spent < least:
        begin = time.perf_counter()
        out = call()
        took = time.perf_counter() - begin
        best, spent, runs = min(best, took), spent + took, runs + 1
    return out, best


def outlet_flow(machine, y, t, h) -> dict:
    """What is added up over the steps."""
    return {FLOW: machine.evaluate(y, t, h, y)[0].outlet_flow}


def reference(values: dict, compiled, cores: int) -> np.ndarray:
    """The mean flow of each design in the third cycle, at a step of less than a microsecond."""
    few = {n: v[: max(FEW.values())] for n, v in values.items()}
    if c_loop.available():
        loop = c_loop.of_bench("float64", outlet_flow)
        march = functools.partial(loop, threads=cores)
    elif compiled is not None:
        march = NumbaLoop(compiled, "float64")
    else:
        sys.exit("the reference needs g++ or numba")
    print(f"reference: {REFERENCE_STEPS} steps a cycle, {len(few['frequency'])} designs", flush=True)
    return third_cycle(march, few, REFERENCE_STEPS)


def third_cycle(march, values: dict, per_cycle: int) -> np.ndarray:
    """The mean flow of the third cycle from a loop that adds it up."""
    h = 1.0 / (FREQUENCY * per_cycle)
    before = march(values, 2 * per_cycle, h)
    y, _, number = before
    return march(values, per_cycle, h, before=(y, {}, number))[1][FLOW] / per_cycle


def package(values: dict, tight: np.ndarray, cores: int) -> Row:
    """The batch engine at the largest step and in the precision that serve."""
    machine, rows = c_loop.bench_machine(), []
    few = {n: v[: len(tight)] for n, v in values.items()}
    for dtype in DTYPES:
        for step in STEPS:
            settings = BatchSettings(step=step, tolerance=-1.0, max_cycles=CYCLES, precision=Precision(dtype))
            error = worst(run_designs(machine, few, settings)["mean_flow"], tight)
            if error <= ALLOWED:
                _, took = best_of(functools.partial(run_designs, machine, values, settings))
                rate = END * len(values["frequency"]) / took / cores
                rows.append(Row("package", f"{dtype}, {steps_per_cycle(FREQUENCY, step)} steps a cycle", error, rate))
                break
    return max(rows, key=lambda row: row.rate)


def looped(name: str, march_of, values: dict, tight: np.ndarray, cores: int) -> Row:
    """A loop of the same step, `march_of(dtype)`, at the largest step and in the precision that serve."""
    rows = []
    few = {n: v[: len(tight)] for n, v in values.items()}
    for dtype in DTYPES:
        march = march_of(dtype)
        for step in STEPS:
            per_cycle = steps_per_cycle(FREQUENCY, step)
            error = worst(third_cycle(march, few, per_cycle), tight)
            if error <= ALLOWED:
                h = 1.0 / (FREQUENCY * per_cycle)
                _, took = best_of(functools.partial(march, values, CYCLES * per_cycle, h))
                rate = END * len(values["frequency"]) / took / cores
                rows.append(Row(name, f"{dtype}, {per_cycle} steps a cycle", error, rate))
                break
    return max(rows, key=lambda row: row.rate)


def in_c(values: dict, tight: np.ndarray, cores: int) -> Row:
    """The C loop."""
    return looped(
        "c", lambda dtype: functools.partial(c_loop.of_bench(dtype, outlet_flow), threads=cores), values, tight, cores
    )


# ---- what Numba compiles: right side, Jacobian and loop, written out as Python ----


def rates(machine, y: dict, t) -> dict:
    """d(state)/dt, and that of the volume delivered."""
    s, found = machine.evaluate(y, t, 1.0, y)
    for name, pole in s.record.strain_poles.items():
        found[name] = found[name] / (1.0 + pole / jnp.square(y[name]))
    return found | {FLOW: s.outlet_flow}


def start() -> dict[str, float]:
    """The state at rest."""
    return {n: float(v) for n, v in c_loop.bench_machine().initial_state().items()}


def right_side(p, y, t) -> dict:
    """The rates of the bench with some parameters."""
    return rates(c_loop.varied(c_loop.bench_machine(), p), y, t)


def exact_jacobian(p, y, t) -> dict:
    """{"output|input": ∂rate/∂state} without structural zeros."""
    rows = jacobian(linearize(functools.partial(right_side, p, t=t), y))
    return {f"{i}|{j}": value for i, row in rows.items() for j, value in row.items()}


LEVELS = {"p": dict.fromkeys(c_loop.VARIED, Dependence.INVARIANT), "t": Dependence.STEP}
FUNCTIONS = {n: (lambda p, x, n=n: p.node(n, x)) for n in ("exp", "log1p", "sin", "cos")}  # Numba has its own


def program_of(f, dtype: str = "float64", **more: Dependence) -> Program:
    """The program of f(p, y, t, …): inputs and outputs by name."""
    levels = LEVELS | {"y": dict.fromkeys(start(), Dependence.CARRY)} | more
    program, structure = trace_to_ir(lambda inputs: f(**inputs), dtype, levels, functions=FUNCTIONS)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_flatten_with_path(levels)[0]]
    program.nodes = [("input", names[n[1]], n[2]) if n[0] == "input" else n for n in program.nodes]
    numbers = jax.tree.unflatten(structure, list(range(structure.num_leaves)))
    program.outputs = {n: program.outputs[k] for n, k in numbers.items()}
    return program


_TEXT = {
    "add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "neg": "-{}", "reciprocal": "one / {}",
    "sqrt": "math.sqrt({})", "rsqrt": "one / math.sqrt({})", "inverse_root4": "one / math.sqrt(math.sqrt({}))",
    "abs": "abs({})", "exp": "math.exp({})", "log1p": "math.log1p({})", "sin": "math.sin({})", "cos": "math.cos({})",
    "max": "{0} if {0} > {1} else {1}", "min": "{0} if {0} < {1} else {1}", "gt": "{} > {}", "ge": "{} >= {}",
    "eq": "{} == {}", "ne": "{} != {}", "not": "not {}", "and": "{} and {}", "select": "{1} if {0} else {2}",
}  # fmt: skip


def python_source(program: Program, prefix: str) -> tuple[dict[Dependence, list[str]], dict[str, str], list[str]]:
    """Statements by level, the name of each output, and the constants as definitions outside the function."""
    names: dict[int, str] = {}
    lines: dict[Dependence, list[str]] = {level: [] for level in Dependence}
    inputs = {f"['y'][{n!r}]": f"y{i}" for i, n in enumerate(sorted(start()))}
    inputs |= {f"['p'][{n!r}]": f"p{i}" for i, n in enumerate(c_loop.VARIED)} | {"['t']": "t", "['h']": "h"}
    constants = [f"{prefix}one = real(1.0)"]
    for i in program.schedule():
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = inputs[args[0]]
        elif op == "const":
            names[i] = f"{prefix}k{i}"
            constants.append(f"{prefix}k{i} = real({args[0]!r})")
        else:
            names[i] = f"x{i}"
            text = _TEXT[op].format(*(names[j] for j in args)).replace("one /", f"{prefix}one /")
            lines[program.dependence[i]].append(f"x{i} = {text}")
    return lines, {n: names[i] for n, i in program.outputs.items()}, constants


def numba_module(folder: Path) -> Path:
    """A file of Python with right side, Jacobian and the loop in both precisions, which Numba compiles and caches."""
    parts = ["import math\n\nimport numba\nimport numpy as np\n", "real = np.float64"]
    states, rows = sorted(start()), [*sorted(start()), FLOW]
    unpack = [f"y{i} = y[{i}]" for i in range(len(states))] + [f"p{i} = p[{i}]" for i in range(len(c_loop.VARIED))]
    for name, f in (("rhs", right_side), ("jac", exact_jacobian)):
        lines, out, constants = python_source(program_of(f), name + "_")
        shape = (len(rows),) if name == "rhs" else (len(rows), len(rows))
        body = [*unpack, *(line for level in Dependence for line in lines[level]), f"out = np.zeros({shape})"]
        for n, value in out.items():
            at = ", ".join(str(rows.index(key)) for key in n.split("|"))
            body.append(f"out[{at}] = {value}")
        head = f'\n\n@numba.njit(error_model="numpy", fastmath=True, cache=True)\ndef {name}(t, y, p):\n    '
        parts += [*constants, head + "\n    ".join([*body, "return out"]), "\n"]
    for dtype in DTYPES:
        parts += loop_source(dtype)
    file = folder / "compiled.py"
    file.write_text("\n".join(parts) + "\n")
    return file


def loop_source(dtype: str) -> list[str]:
    """The march of every design, one after the other on each core, as one writes it for Numba."""
    one = functools.partial(_step_and_flow, dtype)
    lines, out, constants = python_source(program_of(one, dtype, h=Dependence.INVARIANT), dtype + "_")
    states, deep = sorted(start()), "\n            "
    flow = len(states)
    head = [f"y{i} = Y[{i}, d]" for i in range(len(states))] + [f"p{i} = P[{i}, d]" for i in range(len(c_loop.VARIED))]
    text = f"""
@numba.njit(parallel=True, error_model="numpy", fastmath=True, cache=True)
def loop_{dtype}(Y, P, h, first, steps):
    for d in numba.prange(Y.shape[1]):
        {(deep[:-4]).join(head)}
        s = Y[{flow}, d]
        {(deep[:-4]).join(lines[Dependence.INVARIANT])}
        for n in range(first, first + steps):
            t = np.{dtype}(n) * h
            {deep.join(lines[Dependence.STEP] + lines[Dependence.CARRY])}
            s += {out[FLOW]}
            {deep.join(f"z{i} = {out['y ' + n]}" for i, n in enumerate(states))}
            {deep.join(f"y{i} = z{i}" for i in range(len(states)))}
        {(deep[:-4]).join(f"Y[{i}, d] = y{i}" for i in range(len(states)))}
        Y[{flow}, d] = s
"""
    return [f"real = np.{dtype}", *constants, text]


def _step_and_flow(dtype: str, p, y, t, h) -> dict:
    machine = c_loop.varied(c_loop.bench_machine(), p)
    return {f"y {n}": v for n, v in c_loop.step(machine, y, t, h)[0].items()} | outlet_flow(machine, y, t, h)


@functools.lru_cache
def load(file: Path):
    """The module in a file."""
    spec = importlib.util.spec_from_file_location("compiled", file)
    module = importlib.util.module_from_spec(spec)
    sys.modules["compiled"] = module
    spec.loader.exec_module(module)
    return module


class NumbaLoop:
    """Numba's loop with the same face as the C loop."""

    def __init__(self, file: Path, dtype: str):
        self._run, self._type, self._rows = getattr(load(file), f"loop_{dtype}"), np.dtype(dtype), sorted(start())

    def __call__(self, values: dict, steps: int, h: float, before: tuple | None = None) -> tuple:
        batch = len(values["frequency"])
        y, sums, first = before or ({n: np.full(batch, v) for n, v in start().items()}, {}, 0)
        table = np.stack([*(y[n] for n in self._rows), sums.get(FLOW, np.zeros(batch))]).astype(self._type)
        given = np.stack([values[n] for n in c_loop.VARIED]).astype(self._type)
        self._run(table, given, self._type.type(h), first, steps)
        return dict(zip(self._rows, table, strict=False)), {FLOW: table[-1]}, first + steps


def in_numba(values: dict, tight: np.ndarray, compiled: Path, cores: int) -> Row:
    """Numba's `prange` loop of the same step."""
    few = {n: v[: FEW["numba"]] for n, v in values.items()}
    return looped("numba", functools.partial(NumbaLoop, compiled), few, tight, cores)


# ---- SciPy ----


def scales() -> np.ndarray:
    """The sizes of the states, to which absolute tolerances are proportional; the volume delivered last."""
    size = {"pressure": 1e6, "lift_velocity": 0.1, "lift": 1e-3, "current": 1.0, "control": 1e-4, "gas": 1e-6}
    size |= {"deflection": 1e-5, "piston_position": 1e-3, "piston_velocity": 0.1}
    return np.array([*(next(s for word, s in size.items() if word in n) for n in sorted(start())), 1e-6])


def in_scipy(method: str, values: dict, tight: np.ndarray, compiled: Path, cores: int) -> Row:
    """`solve_ivp` in a pool of processes."""
    count = FEW[method.lower()]
    parameters = np.stack([values[n][:count] for n in c_loop.VARIED], axis=1)
    row = Row(method.lower(), "none serves", math.inf, math.nan)
    with ProcessPoolExecutor(cores, mp_context=get_context("spawn")) as pool:
        list(pool.map(_solve, [(method, 1e-3, p, compiled, 1e-3) for p in parameters[: 2 * cores]]))  # compiles
        for tolerance in TOLERANCES:
            begin = time.perf_counter()
            flow = np.array(list(pool.map(_solve, [(method, tolerance, p, compiled, END) for p in parameters])))
            took = time.perf_counter() - begin
            row = Row(method.lower(), f"rtol {tolerance:g}", worst(flow, tight), END * count / took / cores)
            if row.error <= ALLOWED:
                break
    return row


def _solve(task: tuple) -> float:
    """The mean flow of the third cycle of one design."""
    method, tolerance, parameters, file, end = task
    module, y = load(file), np.array([*(start()[n] for n in sorted(start())), 0.0])
    out = solve_ivp(
        module.rhs, (0.0, end), y, method, args=(parameters,), jac=module.jac, rtol=tolerance,
        atol=tolerance * scales(), t_eval=[end * (CYCLES - 1) / CYCLES, end],
    )  # fmt: skip
    return float(np.diff(out.y[-1])[0] * FREQUENCY) if out.success and out.y.shape[1] == 2 else math.nan


# ---- diffrax ----


def in_diffrax(values: dict, tight: np.ndarray, folder: Path) -> Row:
    """Adaptive Kvaerno methods under `vmap`, the better of the two, on one core.

    They have a process of their own, without the compiler flags of the package: XLA fails on diffrax's loops with them.
    """
    file = folder / "diffrax.npz"
    np.savez(file, tight=tight, **{n: v[: FEW["diffrax"]] for n, v in values.items()})
    core = sorted(os.sched_getaffinity(0))[:1]
    command = [sys.executable, __file__, "--diffrax", str(file)]
    with c_loop.confined(core):
        out = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    return Row(*json.loads(out.splitlines()[-1]))


def diffrax_worker(file: Path) -> None:
    """The work of `in_diffrax`; prints its row as JSON."""
    given = {n: jnp.asarray(v) for n, v in np.load(file).items()}
    tight, rows = np.asarray(given.pop("tight")), []
    few = {n: v[: len(tight)] for n, v in given.items()}
    for name in ("Kvaerno3", "Kvaerno5"):
        solve = jax.jit(jax.vmap(functools.partial(_diffrax_flow, name), in_axes=(None, 0)))
        for tolerance in TOLERANCES:
            error = worst(np.asarray(solve(tolerance, few)), tight)
            print(f"    {name}, rtol {tolerance:g}: error {error:.1e}", file=sys.stderr, flush=True)
            if error <= ALLOWED:
                _, took = best_of(lambda s=solve, tol=tolerance: jax.block_until_ready(s(tol, given)))
                rows.append(Row("diffrax", f"{name}, rtol {tolerance:g}", error, END * len(given["frequency"]) / took))
                break
    print(json.dumps(max(rows, key=lambda row: row.rate, default=Row("diffrax", "none serves", math.inf, math.nan))))


def _diffrax_flow(name: str, tolerance, p: dict):
    import diffrax

    sizes = dict(zip([*sorted(start()), FLOW], scales(), strict=True))

    def scaled(t, z, _):
        found = right_side(p, {n: z[n] * sizes[n] for n in start()}, t)
        return {n: found[n] / sizes[n] for n in sizes}

    solution = diffrax.diffeqsolve(
        diffrax.ODETerm(scaled), getattr(diffrax, name)(), 0.0, END, 1e-5,
        {n: jnp.asarray(v / sizes[n]) for n, v in (start() | {FLOW: 0.0}).items()},
        saveat=diffrax.SaveAt(ts=jnp.array([END * (CYCLES - 1) / CYCLES, END])), max_steps=1_000_000, throw=False,
        stepsize_controller=diffrax.PIDController(rtol=tolerance, atol=tolerance),
    )  # fmt: skip
    volume = solution.ys[FLOW] * sizes[FLOW]
    return jnp.where(solution.result == diffrax.RESULTS.successful, (volume[1] - volume[0]) * FREQUENCY, jnp.nan)


if __name__ == "__main__":
    main()
