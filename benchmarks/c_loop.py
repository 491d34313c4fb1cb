"""The limit of the hardware: the same step as one C loop, written for this processor, timed on one core and on all.

    python benchmarks/c_loop.py [--batch N] [--steps N] [--source FILE]

The operations of `edhas_jax.integrate.step` come from the package's own translation (`edhas_jax.compiler.scalar_ir`:
every value once, what depends on parameters alone before the loop, one reciprocal per divisor) and are written as C++
with one design per vector lane, the state in registers and no memory traffic but the stack. Reciprocals and roots start
from the approximations of the processor and are refined by Newton's rule. It needs g++; nothing of the package uses it.
"""

import argparse
import contextlib
import ctypes
import math
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.jaxpr_to_ir import trace_to_ir
from edhas_jax.compiler.scalar_ir import BOOLEAN_OPERATIONS, Dependence, Program
from edhas_jax.core import structs
from edhas_jax.design.batch.cycle_metrics import cycle_step, empty_sums
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.simulation.integrator import DEFAULT_STEP, step

jax.config.update("jax_enable_x64", True)  # for what this benchmark computes by itself

FLAGS = ("-O3", "-march=native", "-fopenmp", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
VARIED = {
    "frequency": ("reference", 10.0),
    "amplitude": ("reference", 3.5e-3),
    "valve_mass": ("valve", 4.0e-3),
    "valve_seat_diameter": ("valve", 5.2e-3),
    "valve_spring_rate": ("valve", 150.0),
    "valve_preload": ("valve", 0.28),
    "load_orifice_area": ("load", 4.2e-6),
    "piston_diameter": ("pump", 12e-3),
}


def bench_machine() -> PumpBench:
    """The pump bench of the benchmarks: LuGre friction, plunger leakage, entrained air."""
    return PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))


def varied(machine: PumpBench, values: dict[str, Any]) -> PumpBench:
    """`machine` with the parameters in `values`, by their names in `VARIED`."""
    parts: dict[str, dict] = {}
    for name, value in values.items():
        parts.setdefault(VARIED[name][0], {})[name] = value
    return structs.replace(machine, **{part: structs.replace(getattr(machine, part), **p) for part, p in parts.items()})


def designs(batch: int, dtype: str, spread: float = 0.1) -> dict[str, np.ndarray]:
    """`batch` designs whose parameters lie up to `spread` above the nominal ones; the same on every call."""
    rng = np.random.default_rng(0)
    return {n: (value * (1.0 + spread * rng.random(batch))).astype(dtype) for n, (_, value) in VARIED.items()}


# ---- the loop in C++ ----

_HEADER = r"""
#include <cstring>
#if defined(__AVX512F__) && defined(__AVX512DQ__)
#include <immintrin.h>
#define BYTES 64
#elif defined(__AVX__)
#define BYTES 32
#else
#define BYTES 16
#endif
#ifdef SINGLE
typedef float T; typedef int I; typedef unsigned U;
#define C(x) x##f
#else
typedef double T; typedef long long I; typedef unsigned long long U;
#define C(x) x
#endif
typedef T v __attribute__((vector_size(BYTES))); typedef I w __attribute__((vector_size(BYTES)));
#define LANES ((int)(BYTES / sizeof(T)))
#define F static inline __attribute__((always_inline))
F v all(T x) { return v{} + x; }
F w ints(v x) { return (w)x; }
F v reals(w x) { return (v)x; }
#if BYTES == 64
#ifdef SINGLE
typedef __mmask16 m;
#define OF(name, ...) (v)_mm512_##name##_ps(__VA_ARGS__)
#define COMPARE(a, b, how) _mm512_cmp_ps_mask(a, b, how)
#else
typedef __mmask8 m;
#define OF(name, ...) (v)_mm512_##name##_pd(__VA_ARGS__)
#define COMPARE(a, b, how) _mm512_cmp_pd_mask(a, b, how)
#endif
F m gt(v a, v b) { return COMPARE(a, b, _CMP_GT_OQ); }
F m ge(v a, v b) { return COMPARE(a, b, _CMP_GE_OQ); }
F m eq(v a, v b) { return COMPARE(a, b, _CMP_EQ_OQ); }
F m ne(v a, v b) { return COMPARE(a, b, _CMP_NEQ_UQ); }
F v pick(m c, v a, v b) { return OF(mask_blend, c, b, a); }
F v greater(v a, v b) { return OF(max, a, b); }
F v lesser(v a, v b) { return OF(min, a, b); }
F v inverse(v a) {
  v r = OF(rcp14, a);
  r = r + r * (C(1.0) - a * r);
#ifndef SINGLE
  r = r + r * (C(1.0) - a * r);
#endif
  return r;
}
F v inverse_root(v a) {
  v r = OF(rsqrt14, a);
  r = r + r * (C(0.5) - C(0.5) * a * r * r);
#ifndef SINGLE
  r = r + r * (C(0.5) - C(0.5) * a * r * r);
#endif
  return r;
}
F v root(v a) { return a * inverse_root(greater(a, all(C(1e-35)))); }
F v inverse_root4(v a) {  // a^(-1/4)
  v r = OF(rsqrt14, a);
  r = r * OF(rsqrt14, r);
  v s = r * r;
  r = r + r * (C(0.25) - C(0.25) * a * (s * s));
#ifndef SINGLE
  s = r * r;
  r = r + r * (C(0.25) - C(0.25) * a * (s * s));
#endif
  return r;
}
#else
typedef w m;
F m gt(v a, v b) { return a > b; }
F m ge(v a, v b) { return a >= b; }
F m eq(v a, v b) { return a == b; }
F m ne(v a, v b) { return a != b; }
F v pick(m c, v a, v b) { return c ? a : b; }
F v greater(v a, v b) { return a > b ? a : b; }
F v lesser(v a, v b) { return a < b ? a : b; }
F v root(v a) {
  v r;
  for (int l = 0; l < LANES; l++) r[l] = sizeof(T) == 4 ? __builtin_sqrtf(a[l]) : __builtin_sqrt(a[l]);
  return r;
}
F v inverse(v a) { return C(1.0) / a; }
F v inverse_root(v a) { return C(1.0) / root(a); }
F v inverse_root4(v a) { return C(1.0) / root(root(a)); }
#endif
F v size(v a) { return reals(ints(a) & (I)((U)~(U)0 >> 1)); }
#ifdef SINGLE
#define MANTISSA 23
#else
#define MANTISSA 52
#endif
F v power_of_two(v n) {
  return reals((__builtin_convertvector(n, w) + (sizeof(T) == 4 ? 127 : 1023)) << MANTISSA);
}
F v exponent(v a) {  // the k for which a / 2^k lies between sqrt(1/2) and sqrt(2)
#ifdef SINGLE
  w k = (ints(a) - 0x3f3504f3) >> 23;
#else
  w k = (ints(a) - 0x3fe6a09e667f3bcdLL) >> 52;
#endif
  return __builtin_convertvector(k, v);
}
F v load(const T* p) { v x; memcpy(&x, p, sizeof x); return x; }
F void store(T* p, v x) { memcpy(p, &x, sizeof x); }
"""
_CALLS = {
    "sqrt": "root", "rsqrt": "inverse_root", "inverse_root4": "inverse_root4", "reciprocal": "inverse", "abs": "size",
    "power_of_two": "power_of_two", "exponent": "exponent", "max": "greater", "min": "lesser",
    "gt": "gt", "ge": "ge", "eq": "eq", "ne": "ne", "select": "pick",
}  # fmt: skip
_SIGNS = {"add": "+", "sub": "-", "mul": "*"}
_BEYOND = {"inf": "__builtin_inf()", "-inf": "-__builtin_inf()", "nan": '__builtin_nan("")'}
VECTORS = 2


def c_source(program: Program, dtype: str, states: int, parameters: int, sums: int) -> str:
    """The whole C++ file: a program of step number, states, sums, parameters and step size, in this order.

    Every statement is written `VECTORS` times, for as many vectors of designs: one alone waits for its own results.
    """
    names: dict[int, str] = {}
    lines: dict[Dependence, list[str]] = {level: [] for level in Dependence}
    inputs = ["t", *[f"y{i}_#" for i in range(states)], *[f"s{i}_#" for i in range(sums)]]
    inputs += [*[f"p{i}_#" for i in range(parameters)], "h"]
    for i in program.schedule():
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = inputs[args[0]]
        elif op == "const":
            names[i] = f"all(C({args[0]!r}))" if math.isfinite(args[0]) else f"all((T){_BEYOND[str(args[0])]})"
        else:
            a = [names[j] for j in args]
            if op in _SIGNS:
                text = f"{a[0]} {_SIGNS[op]} {a[1]}"
            elif op == "neg":
                text = f"-{a[0]}"
            elif op == "not":
                text = f"~{a[0]}"
            elif op == "and":
                text = f"{a[0]} & {a[1]}"
            else:
                text = f"{_CALLS[op]}({', '.join(a)})"
            names[i] = f"x{i}_#"
            lines[program.dependence[i]].append(f"{'m' if op in BOOLEAN_OPERATIONS else 'v'} x{i}_# = {text};")
    out, width = [names[program.outputs[k]] for k in range(states + sums)], states + sums
    rows = inputs[1 : 1 + width]

    def written(statements, deep: int) -> str:
        return ("\n" + " " * deep).join(s.replace("#", str(j)) for s in statements for j in range(VECTORS))

    return f"""{"#define SINGLE" if dtype == "float32" else ""}
{_HEADER}
#define WIDE ({VECTORS} * LANES)
extern "C" int lanes() {{ return WIDE; }}
// one block: {width} rows of WIDE numbers (states, then sums), {parameters} rows of parameters
static void block(T* Y, const T* P, T step, long first, long steps) {{
  const v h = all(step);
  {written([f"v p{i}_# = load(P + {i} * WIDE + # * LANES);" for i in range(parameters)], 2)}
  {written([f"v {row} = load(Y + {i} * WIDE + # * LANES);" for i, row in enumerate(rows)], 2)}
  {written(lines[Dependence.INVARIANT], 2)}
  for (long n = first; n < first + steps; n++) {{
    const v t = all((T)n);
    {written(lines[Dependence.STEP] + lines[Dependence.CARRY], 4)}
    {written([f"v z{i}_# = {value};" for i, value in enumerate(out)], 4)}
    {written([f"{row} = z{i}_#;" for i, row in enumerate(rows)], 4)}
  }}
  {written([f"store(Y + {i} * WIDE + # * LANES, {row});" for i, row in enumerate(rows)], 2)}
}}
extern "C" void run(T* Y, const T* P, T step, long first, long steps, long blocks, int threads) {{
  #pragma omp parallel for schedule(dynamic) num_threads(threads)
  for (long b = 0; b < blocks; b++) block(Y + b * {width} * WIDE, P + b * {parameters} * WIDE, step, first, steps);
}}
"""


class Loop:
    """A compiled loop.

    `program` is what it computes, `source` the C++ text, `lanes` the designs that are marched together.
    """

    def __init__(self, program: Program, source: str, dtype: str, state: dict, parameters: list[str], sums: list[str]):
        self.program, self.source, self.dtype = program, source, np.dtype(dtype)
        self._state, self._names, self._parameters, self._sums = state, list(state), parameters, sums
        self._folder = tempfile.TemporaryDirectory()
        file = Path(self._folder.name) / "loop.cpp"
        file.write_text(source)
        begin = time.perf_counter()
        subprocess.run([_compiler(), *FLAGS, "-shared", "-fPIC", file, "-o", file.with_suffix(".so")], check=True)
        self.compile_seconds = time.perf_counter() - begin
        library = ctypes.CDLL(str(file.with_suffix(".so")))
        self.lanes = library.lanes()
        self._run = library.run

    def __call__(
        self, parameters: dict[str, np.ndarray], steps: int, h: float, threads: int = 1, before: tuple | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, np.ndarray], int]:
        """State, sums and number of the last step after `steps` more steps of `h`, from rest or from such a triple."""
        batch = len(next(iter(parameters.values())))
        y, s, first = before or ({n: np.full(batch, v) for n, v in self._state.items()}, {}, 0)
        rows = [y[n] for n in self._names] + [s.get(n, np.zeros(batch)) for n in self._sums]
        numbers, given = self._packed(rows), self._packed([parameters[n] for n in self._parameters])
        scalar = ctypes.c_float if self.dtype == np.float32 else ctypes.c_double
        c = ctypes
        self._run(
            numbers.ctypes.data_as(c.c_void_p), given.ctypes.data_as(c.c_void_p), scalar(h),
            c.c_long(first), c.c_long(steps), c.c_long(len(numbers)), c.c_int(threads),
        )  # fmt: skip
        flat = numbers.transpose(1, 0, 2).reshape(len(rows), -1)[:, :batch]
        found = dict(zip([*self._names, *self._sums], flat, strict=True))
        return {n: found[n] for n in self._names}, {n: found[n] for n in self._sums}, first + steps

    def _packed(self, rows: list) -> np.ndarray:
        """Blocks of lanes; the last block is filled up with its last design."""
        table = np.stack([np.asarray(r, self.dtype) for r in rows])
        table = np.pad(table, ((0, 0), (0, -table.shape[1] % self.lanes)), mode="edge")
        return np.ascontiguousarray(table.reshape(len(rows), -1, self.lanes).transpose(1, 0, 2))


def build(
    machine_of: Callable[[dict], Any], state: dict[str, float], parameters: list[str], dtype: str,
    sums: Callable[[Any, dict, Any, Any], dict] = lambda machine, y, t, h: {},
) -> Loop:  # fmt: skip
    """The C loop of the step of `machine_of({name: value})` for the named parameters, starting from `state`.

    `sums(machine, y, t, h)` names quantities to be added up over the steps, at the beginning of each.
    """
    kept: dict[str, None] = {}

    def one(n, y, before, p, h):
        machine = machine_of(dict(zip(parameters, p, strict=True)))
        new = sums(machine, dict(zip(names, y, strict=True)), n * h, h)
        kept.update(dict.fromkeys(new))
        after = step(machine, dict(zip(names, y, strict=True)), n * h, h)[0]
        return [after[k] for k in names], [b + v for b, v in zip(before, new.values(), strict=True)]

    names = sorted(state)
    count = len(sums(machine_of({n: 1.0 for n in parameters}), state, 0.0, DEFAULT_STEP))
    levels = [Dependence.CARRY] * len(names), [Dependence.CARRY] * count, [Dependence.INVARIANT] * len(parameters)
    program, _ = trace_to_ir(one, dtype, Dependence.STEP, *levels, Dependence.INVARIANT)
    source = c_source(program, dtype, len(names), len(parameters), count)
    return Loop(program, source, dtype, {n: state[n] for n in names}, list(parameters), list(kept))


def of_bench(dtype: str, sums: Callable = lambda machine, y, t, h: {}) -> Loop:
    """The loop of the pump bench of the benchmarks over the parameters in `VARIED`."""
    machine = bench_machine()
    start = {n: float(v) for n, v in machine.initial_state().items()}
    return build(lambda p: varied(machine, p), start, list(VARIED), dtype, sums)


def of_cycle(dtype: str) -> Loop:
    """The loop of `of_bench` with all that the batch engine does besides: sums and peaks for its metrics.

    In place of a step size it takes the number of steps in a cycle.
    """
    machine = bench_machine()
    start = {n: float(v) for n, v in machine.initial_state().items()}
    kept = {n: float(v) for n, v in empty_sums(machine, np.dtype(dtype)).items()}
    parameters, carry = list(VARIED), start | kept

    def one(n, carried, p, steps):
        y, sums = carried[: len(start)], carried[len(start) :]
        y, sums = dict(zip(start, y, strict=True)), dict(zip(kept, sums, strict=True))
        y, sums = cycle_step(varied(machine, dict(zip(parameters, p, strict=True))), y, sums, n, steps, False)
        return [*(y[k] for k in start), *(sums[k] for k in kept)]

    levels = [Dependence.CARRY] * len(carry), [Dependence.INVARIANT] * len(parameters)
    program, _ = trace_to_ir(one, dtype, Dependence.STEP, *levels, Dependence.INVARIANT)
    source = c_source(program, dtype, len(carry), len(parameters), 0)
    return Loop(program, source, dtype, carry, parameters, [])


@contextlib.contextmanager
def confined(cores: list[int]):
    """Processes that are started meanwhile may use these cores only."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


def available() -> bool:
    """Whether there is a compiler."""
    return _compiler() is not None


def _compiler() -> str | None:
    return os.environ.get("CXX") or shutil.which("g++")


def difference(loop: Loop, batch: int, steps: int) -> float:
    """The largest difference from the step of the package after `steps` steps, relative to the size of each state."""
    values, h = designs(batch, str(loop.dtype)), loop.dtype.type(DEFAULT_STEP)
    machine = jax.tree.map(lambda leaf: jnp.asarray(leaf, loop.dtype), bench_machine())

    def one(p):
        ready = varied(machine, p)
        y = {n: jnp.asarray(v, loop.dtype) for n, v in machine.initial_state().items()}
        return jax.lax.fori_loop(0, steps, lambda i, y: step(ready, y, i.astype(loop.dtype) * h, h)[0], y)

    expected = jax.device_get(jax.jit(jax.vmap(one))(values))
    found = loop(values, steps, h)[0]
    worst = {n: np.abs(found[n] - e).max() / np.abs(e).max() for n, e in expected.items() if np.abs(e).max() > 0.0}
    return max(worst.values())


def rate(loop: Loop, batch: int, steps: int, threads: int, h: float = DEFAULT_STEP, repeats: int = 5) -> float:
    """Design-steps per second, the best of some runs."""
    values, best = designs(batch, str(loop.dtype)), math.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        loop(values, steps, h, threads)
        best = min(best, time.perf_counter() - begin)
    return batch * steps / best


_SHOWN = Dependence.INVARIANT, Dependence.STEP, Dependence.CARRY


def main() -> None:
    """Print the rates; the last line sums them up as key=value."""
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("--batch", type=int, default=256)
    options.add_argument("--steps", type=int, default=4000)
    options.add_argument("--source", type=Path, help="write the C++ text of the float32 loop to this file")
    options = options.parse_args()
    if not available():
        sys.exit("g++ is needed")
    summary = {}
    cores = len(os.sched_getaffinity(0))
    for dtype in ("float32", "float64"):
        loop = of_bench(dtype)
        if options.source and dtype == "float32":
            options.source.write_text(loop.source)
        if dtype == "float32":
            for level, what in zip(_SHOWN, ("before the loop", "on time alone", "on the state"), strict=True):
                counts = loop.program.count_operations(level)
                listed = ", ".join(f"{n} {op}" for op, n in counts.most_common())
                print(f"operations {what}: {sum(counts.values())} ({listed})")
        apart = difference(loop, 64, options.steps)
        print(f"{dtype}: {loop.lanes} designs at a time, compiled in {loop.compile_seconds:.1f} s, ", end="")
        print(f"{apart:.1e} from the package")
        for threads in sorted({1, cores}):
            found = rate(loop, options.batch, options.steps, threads)
            summary[f"{dtype.replace('float', 'f')}_{threads}"] = found
            print(f"  {threads} thread{'s' if threads > 1 else ' '} {found / 1e6:8.2f} M design-steps/s", flush=True)
    print(" ".join(f"{name}={value:.4g}" for name, value in summary.items()))


if __name__ == "__main__":
    main()
