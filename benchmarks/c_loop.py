"""The limit of the hardware: the same step as one C loop, written for this processor, timed on one core and on all.

    python benchmarks/c_loop.py [--batch N] [--steps N] [--source FILE]

The operations of `edhas_jax.integrate.step` are taken from its jaxpr, simplified as one would by hand (every value
once, what depends on parameters alone before the loop, one reciprocal per divisor), and written as C++ with one design
per vector lane, the state in registers and no memory traffic but the stack. Reciprocals and roots start from the
approximations of the processor and are refined by Newton's rule; sine, cosine, exponential and logarithm are inlined
polynomials. It needs g++; nothing of the package uses it.
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
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from edhas_jax import tree
from edhas_jax.effects import EntrainedAir, LugreFriction, PistonLeakage
from edhas_jax.integrate import DEFAULT_STEP, step
from edhas_jax.system import PumpBench

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
    return tree.replace(machine, **{part: tree.replace(getattr(machine, part), **p) for part, p in parts.items()})


def designs(batch: int, dtype: str, spread: float = 0.1) -> dict[str, np.ndarray]:
    """`batch` designs whose parameters lie up to `spread` above the nominal ones; the same on every call."""
    rng = np.random.default_rng(0)
    return {n: (value * (1.0 + spread * rng.random(batch))).astype(dtype) for n, (_, value) in VARIED.items()}


# ---- the program: operations on scalars, each value once ----

PARAMETER, TIME, STATE = 0, 1, 2  # what a value depends on at most
_LEAVES = ("input", "const", "truth")
_INLINE = ("jit", "pjit", "closed_call", "core_call", "custom_jvp_call")
_SAME = ("convert_element_type", "copy", "stop_gradient", "broadcast_in_dim", "reshape", "squeeze")
_UNARY = {"sqrt": math.sqrt, "exp": math.exp, "sin": math.sin, "cos": math.cos, "log1p": math.log1p, "abs": abs}
_UNARY["rsqrt"] = lambda x: 1.0 / math.sqrt(x)
_FLIPPED = {"gt": "le", "le": "gt", "lt": "ge", "ge": "lt", "eq": "ne", "ne": "eq"}


class Program:
    """A program of scalars without control flow: `nodes[i]` is (operation, operands…), operands are indices.

    Operations are built by the methods, which simplify on the way; `outputs` names the results.
    """

    def __init__(self, dtype: str):
        self._type = np.dtype(dtype).type
        self.nodes: list[tuple] = []
        self.level: list[int] = []
        self.outputs: dict[str, int] = {}
        self._number: dict[tuple, int] = {}

    def _node(self, operation: str, *operands) -> int:
        key = (operation, *operands)
        if key not in self._number:
            self._number[key] = len(self.nodes)
            self.nodes.append(key)
            self.level.append(
                max((self.level[i] for i in operands), default=PARAMETER)
                if operation not in _LEAVES
                else operands[1] if operation == "input" else PARAMETER
            )
        return self._number[key]

    def input(self, name: str, level: int) -> int:
        return self._node("input", name, level)

    def const(self, value) -> int:
        if isinstance(value, bool | np.bool_):
            return self._node("truth", bool(value))
        return self._node("const", float(self._type(value)))

    def value(self, i: int):
        """The value of a constant, else None."""
        return self.nodes[i][1] if self.nodes[i][0] in ("const", "truth") else None

    def neg(self, a: int) -> int:
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(-args[0])
        if op == "neg":
            return args[0]
        if op == "sub":
            return self.sub(args[1], args[0])
        return self._node("neg", a)

    def add(self, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0.0 or y == 0.0:
            return b if x == 0.0 else a
        if self.nodes[b][0] == "neg":
            return self.sub(a, self.nodes[b][1])
        if self.nodes[a][0] == "neg":
            return self.sub(b, self.nodes[a][1])
        return self._node("add", *sorted((a, b)))

    def sub(self, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x - y)
        if y == 0.0:
            return a
        if a == b:
            return self.const(0.0)
        if x == 0.0:
            return self.neg(b)
        if self.nodes[b][0] == "neg":
            return self.add(a, self.nodes[b][1])
        if self.nodes[a][0] == "neg":
            return self.neg(self.add(self.nodes[a][1], b))
        return self._node("sub", a, b)

    def mul(self, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if y is not None:
            (a, x), (b, y) = (b, y), (a, x)
        if x == 0.0:
            return a
        if x == 1.0:
            return b
        if x == -1.0:
            return self.neg(b)
        negative = (self.nodes[a][0] == "neg") ^ (self.nodes[b][0] == "neg")
        a, b = (self.nodes[i][1] if self.nodes[i][0] == "neg" else i for i in (a, b))
        if x is not None and x < 0.0:
            a, x, negative = self.const(-x), -x, not negative
        if x is not None and self.nodes[b][0] == "mul":  # constants come together
            for one, other in (self.nodes[b][1:], self.nodes[b][:0:-1]):
                if self.value(one) is not None:
                    a, b = self.const(x * self.value(one)), other
                    break
        out = self._node("mul", *sorted((a, b)))
        return self.neg(out) if negative else out

    def reciprocal(self, a: int) -> int:
        op, *args = self.nodes[a]
        if op == "const":
            return self.const(1.0 / args[0]) if args[0] else self.const(math.inf)
        if op == "neg":
            return self.neg(self.reciprocal(args[0]))
        if op == "reciprocal":
            return args[0]
        if op == "sqrt":
            return self.unary("rsqrt", args[0])
        return self._node("reciprocal", a)

    def unary(self, op: str, a: int) -> int:
        if self.value(a) is not None:
            return self.const(_UNARY[op](self.value(a)))
        if op == "abs" and self.nodes[a][0] in ("neg", "abs"):
            return self.unary(op, self.nodes[a][1])
        if op == "cos" and self.nodes[a][0] == "neg":
            a = self.nodes[a][1]
        if op in ("sqrt", "rsqrt") and self.nodes[a][0] in ("sqrt", "rsqrt"):
            inside = self.nodes[a][1]
            fourth = self._node("root4", inside)
            return fourth if op != self.nodes[a][0] else self.mul(self._node("sqrt", inside), fourth)
        return self._node(op, a)

    def with_shared_roots(self) -> "Program":
        """The same program with √a and 1/√a taken from the a^(-¼) or 1/√a that is computed anyway."""
        out = Program(self._type)
        known = {node for node in self.nodes}
        moved: dict[int, int] = {}
        for i in self.order():
            op, *args = self.nodes[i]
            if op in _LEAVES:
                moved[i] = out._node(op, *args)
            elif op in ("sqrt", "rsqrt") and ("root4", args[0]) in known:
                fourth = out._node("root4", moved[args[0]])
                inverse = out.mul(fourth, fourth)
                moved[i] = inverse if op == "rsqrt" else out.mul(moved[args[0]], inverse)
            elif op == "sqrt" and ("rsqrt", args[0]) in known:
                moved[i] = out.mul(moved[args[0]], out._node("rsqrt", moved[args[0]]))
            else:
                moved[i] = out._node(op, *(moved[j] for j in args))
        out.outputs = {n: moved[i] for n, i in self.outputs.items()}
        return out

    def extreme(self, op: str, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(max(x, y) if op == "max" else min(x, y))
        return a if a == b else self._node(op, *sorted((a, b)))

    def compare(self, op: str, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const({"gt": x > y, "lt": x < y, "ge": x >= y, "le": x <= y, "eq": x == y, "ne": x != y}[op])
        if op in ("lt", "le"):
            op, a, b = {"lt": "gt", "le": "ge"}[op], b, a
        return self._node(op, a, b)

    def invert(self, a: int) -> int:
        op, *args = self.nodes[a]
        if op == "truth":
            return self.const(not args[0])
        if op == "not":
            return args[0]
        return self._node("not", a)

    def both(self, a: int, b: int) -> int:
        for one, other in ((a, b), (b, a)):
            if self.value(one) is not None:
                return other if self.value(one) else one
        return a if a == b else self._node("and", *sorted((a, b)))

    def select(self, which: int, yes: int, no: int) -> int:
        if self.value(which) is not None:
            return yes if self.value(which) else no
        if self.nodes[which][0] == "not":
            which, yes, no = self.nodes[which][1], no, yes
        return yes if yes == no else self._node("select", which, yes, no)

    def equation(self, eqn, args: list[int]) -> list[int]:
        """The results of an equation of a jaxpr."""
        name = eqn.primitive.name
        if name in _INLINE:
            inner = eqn.params.get("jaxpr") or eqn.params["call_jaxpr"]
            return self.read(getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), args)
        out_bool = eqn.outvars[0].aval.dtype == bool
        if name in _SAME:
            if eqn.invars[0].aval.dtype == bool and not out_bool:
                return [self.select(args[0], self.const(1.0), self.const(0.0))]
            return args
        if name in ("add", "add_any"):
            return [self.add(*args)]
        if name in ("sub", "mul", "neg"):
            return [getattr(self, name)(*args)]
        if name == "div":
            return [self.mul(args[0], self.reciprocal(args[1]))]
        if name in ("square", "integer_pow"):
            power, out = eqn.params.get("y", 2), args[0]
            for _ in range(abs(power) - 1):
                out = self.mul(out, args[0])
            return [out if power > 0 else self.reciprocal(out)]
        if name in ("max", "min"):
            return [self.extreme(name, *args)]
        if name == "clamp":
            return [self.extreme("min", self.extreme("max", args[1], args[0]), args[2])]
        if name in _UNARY:
            return [self.unary(name, *args)]
        if name in _FLIPPED:
            return [self.compare(name, *args)]
        if name == "select_n":
            return [self.select(args[0], args[2], args[1])]
        if name == "not":
            return [self.invert(*args)]
        if name == "and":
            return [self.both(*args)]
        if name == "or":
            return [self.invert(self.both(self.invert(args[0]), self.invert(args[1])))]
        if name == "sign":
            zero, one = self.const(0.0), self.const(1.0)
            below = self.select(self.compare("lt", args[0], zero), self.const(-1.0), zero)
            return [self.select(self.compare("gt", args[0], zero), one, below)]
        raise NotImplementedError(f"the operation `{name}` of the step has no counterpart here")

    def read(self, jaxpr, consts, args: list[int]) -> list[int]:
        """Take in a jaxpr; the indices of its results."""
        env = {v: self.const(np.asarray(c).item()) for v, c in zip(jaxpr.constvars, consts, strict=True)}
        env |= zip(jaxpr.invars, args, strict=True)
        for eqn in jaxpr.eqns:
            given = [
                self.const(np.asarray(a.val).item()) if isinstance(a, core.Literal) else env[a] for a in eqn.invars
            ]
            env |= zip(eqn.outvars, self.equation(eqn, given), strict=True)
        return [
            self.const(np.asarray(a.val).item()) if isinstance(a, core.Literal) else env[a] for a in jaxpr.outvars
        ]

    def order(self) -> list[int]:
        """The nodes the outputs need, operands first, each output's own where it is needed first."""
        seen: dict[int, None] = {}
        for root in self.outputs.values():
            stack = [(root, False)]
            while stack:
                i, done = stack.pop()
                if done:
                    seen[i] = None
                elif i not in seen:
                    stack.append((i, True))
                    stack.extend((j, False) for j in self.operands(i)[::-1] if j not in seen)
        return list(seen)

    def operands(self, i: int) -> tuple:
        op, *args = self.nodes[i]
        return () if op in _LEAVES else tuple(args)

    def count(self, level: int = STATE) -> Counter:
        """How often each operation occurs among the values that depend on `level` at most and at least."""
        return Counter(
            self.nodes[i][0] for i in self.order() if self.level[i] == level and self.nodes[i][0] not in _LEAVES
        )


def transcribe(f: Callable[..., dict], dtype: str, **inputs: dict[str, int] | int) -> Program:
    """The program of `f(**inputs)`: each input is a dict of scalars or a scalar, given here by level or levels."""
    leaves, structure = jax.tree.flatten(inputs)
    names = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_flatten_with_path(inputs)[0]]
    keys: list[str] = []

    def flat(*scalars):
        out = f(**jax.tree.unflatten(structure, scalars))
        keys[:] = sorted(out)
        return [jnp.asarray(out[n]) for n in keys]

    closed = jax.make_jaxpr(flat)(*[jax.ShapeDtypeStruct((), dtype)] * len(leaves))
    program = Program(dtype)
    arguments = [program.input(name, level) for name, level in zip(names, leaves, strict=True)]
    results = program.read(closed.jaxpr, closed.consts, arguments)
    program.outputs = dict(zip(keys, results, strict=True))
    return program.with_shared_roots()


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
#define SHIFTER 12582912.f
#else
#define MANTISSA 52
#define SHIFTER 6755399441055744.0
#endif
template <int N> F v polynomial(v x, const T (&c)[N]) {
  v r = all(c[N - 1]);
  for (int i = N - 2; i >= 0; i--) r = r * x + c[i];
  return r;
}
F v exponential(v x) {
  x = greater(lesser(x, all(C(80.0))), all(sizeof(T) == 4 ? C(-87.0) : C(-700.0)));
  v z = x * C(1.4426950408889634) + SHIFTER, n = z - SHIFTER;
#ifdef SINGLE
  v r = x - n * 0.693359375f + n * 2.12194440e-4f;
#else
  v r = x - n * 6.93145751953125e-1 - n * 1.42860682030941723212e-6;
#endif
  static const T c[] = {1., 1., 1./2, 1./6, 1./24, 1./120, 1./720, 1./5040
#ifndef SINGLE
    , 1./40320, 1./362880, 1./3628800, 1./39916800, 1./479001600, 1./6227020800.
#endif
  };
  return reals(ints(polynomial(r, c)) + (ints(z) << MANTISSA));
}
F v logarithm(v x) {  // log(1 + x)
  v u = C(1.0) + x, lost = x - (u - C(1.0));
#ifdef SINGLE
  w k = (ints(u) - 0x3f3504f3) >> 23;
#else
  w k = (ints(u) - 0x3fe6a09e667f3bcdLL) >> 52;
#endif
  v scale = reals(((w{} + (sizeof(T) == 4 ? 127 : 1023)) - k) << MANTISSA);
  v f = u * scale - C(1.0) + lost * scale, s = f * inverse(C(2.0) + f);
  static const T c[] = {2., 2./3, 2./5, 2./7, 2./9
#ifndef SINGLE
    , 2./11, 2./13, 2./15, 2./17, 2./19, 2./21, 2./23
#endif
  };
  return __builtin_convertvector(k, v) * C(0.6931471805599453) + s * polynomial(s * s, c);
}
struct Turn { v sine, cosine; w quarter; };
F Turn turn(v x) {
  v z = x * C(0.6366197723675814) + SHIFTER, n = z - SHIFTER;
#ifdef SINGLE
  v r = ((x - n * 1.5703125f) - n * 4.837512969970703e-4f) - n * 7.549789948768648e-8f;
#else
  v r = ((x - n * 1.57079625129699707031) - n * 7.54978941586159635335e-8) - n * 5.39030285815811905290e-15;
#endif
  v q = r * r;
  static const T s[] = {-1./6, 1./120, -1./5040, 1./362880
#ifndef SINGLE
    , -1./39916800, 1./6227020800., -1./1307674368000., 1./355687428096000.
#endif
  };
  static const T c[] = {-1./2, 1./24, -1./720, 1./40320, -1./3628800
#ifndef SINGLE
    , 1./479001600, -1./87178291200., 1./20922789888000.
#endif
  };
  return {r + r * q * polynomial(q, s), C(1.0) + q * polynomial(q, c), ints(z)};
}
F v turned(Turn a, int ahead) {
  w k = a.quarter + ahead;
  v r = pick(eq(__builtin_convertvector(k & 1, v), all(0)), a.sine, a.cosine);
  return reals(ints(r) ^ ((k & 2) << (int)(8 * sizeof(T) - 2)));
}
F v sine(v x) { return turned(turn(x), 0); }
F v cosine(v x) { return turned(turn(x), 1); }
F v load(const T* p) { v x; memcpy(&x, p, sizeof x); return x; }
F void store(T* p, v x) { memcpy(p, &x, sizeof x); }
"""
_CALLS = {
    "sqrt": "root", "rsqrt": "inverse_root", "root4": "inverse_root4", "reciprocal": "inverse", "abs": "size",
    "exp": "exponential", "log1p": "logarithm", "sin": "sine", "cos": "cosine", "max": "greater", "min": "lesser",
    "gt": "gt", "ge": "ge", "eq": "eq", "ne": "ne", "select": "pick",
}  # fmt: skip
_SIGNS = {"add": "+", "sub": "-", "mul": "*"}
VECTORS = 2
_BOOLEAN = ("gt", "ge", "eq", "ne", "not", "and")


def c_source(program: Program, dtype: str, states: list[str], parameters: list[str], sums: list[str]) -> str:
    """The whole C++ file; `sums` are the outputs that are added up over the steps.

    Every statement is written `VECTORS` times, for as many vectors of designs: one alone waits for its own results.
    """
    names: dict[int, str] = {}
    lines: dict[int, list[str]] = {PARAMETER: [], TIME: [], STATE: []}
    fixed = {f"['y'][{n!r}]": f"y{i}" for i, n in enumerate(states)}
    fixed |= {f"['p'][{n!r}]": f"p{i}" for i, n in enumerate(parameters)} | {"['t']": "t", "['h']": "h"}
    for i in program.order():
        op, *args = program.nodes[i]
        if op == "input":
            names[i] = fixed[args[0]] + ("" if args[0] in ("['t']", "['h']") else "_#")
        elif op == "const":
            names[i] = f"all(C({args[0]!r}))"
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
            lines[program.level[i]].append(f"{'m' if op in _BOOLEAN else 'v'} x{i}_# = {text};")
    out = {n: names[i] for n, i in program.outputs.items()}
    rows, width = [f"y{i}_#" for i in range(len(states))], len(states) + len(sums)
    rows += [f"s{i}_#" for i in range(len(sums))]

    def written(statements, deep: int) -> str:
        return ("\n" + " " * deep).join(s.replace("#", str(j)) for s in statements for j in range(VECTORS))

    return f"""{"#define SINGLE" if dtype == "float32" else ""}
{_HEADER}
#define WIDE ({VECTORS} * LANES)
extern "C" int lanes() {{ return WIDE; }}
// one block: {width} rows of WIDE numbers (states, then sums), {len(parameters)} rows of parameters
static void block(T* Y, const T* P, T step, long first, long steps) {{
  const v h = all(step);
  {written([f"v p{i}_# = load(P + {i} * WIDE + # * LANES);" for i in range(len(parameters))], 2)}
  {written([f"v {row} = load(Y + {i} * WIDE + # * LANES);" for i, row in enumerate(rows)], 2)}
  {written(lines[PARAMETER], 2)}
  for (long n = first; n < first + steps; n++) {{
    const v t = all((T)n * step);
    {written(lines[TIME] + lines[STATE], 4)}
    {written([f"s{i}_# += {out[n]};" for i, n in enumerate(sums)], 4)}
    {written([f"v z{i}_# = {out[n]};" for i, n in enumerate(states)], 4)}
    {written([f"y{i}_# = z{i}_#;" for i in range(len(states))], 4)}
  }}
  {written([f"store(Y + {i} * WIDE + # * LANES, {row});" for i, row in enumerate(rows)], 2)}
}}
extern "C" void run(T* Y, const T* P, T step, long first, long steps, long blocks, int threads) {{
  #pragma omp parallel for schedule(dynamic) num_threads(threads)
  for (long b = 0; b < blocks; b++) block(Y + b * {width} * WIDE, P + b * {len(parameters)} * WIDE, step, first, steps);
}}
"""


class Loop:
    """A compiled loop.

    `program` is what it computes, `source` the C++ text, `lanes` the designs that are marched together.
    """

    def __init__(self, program: Program, source: str, dtype: str, state: dict, parameters: list[str], sums: list[str]):
        self.program, self.source, self.dtype = program, source, np.dtype(dtype)
        self._state, self._names, self._parameters, self._sums = state, sorted(state), parameters, sums
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

    def one(y, p, t, h):
        machine = machine_of(p)
        return {f"y {n}": v for n, v in step(machine, y, t, h)[0].items()} | sums(machine, y, t, h)

    program = transcribe(
        one, dtype, y=dict.fromkeys(state, STATE), p=dict.fromkeys(parameters, PARAMETER), t=TIME, h=PARAMETER
    )
    kept = [n for n in program.outputs if not n.startswith("y ")]
    program.outputs = {n.removeprefix("y "): i for n, i in program.outputs.items()}
    source = c_source(program, dtype, sorted(state), list(parameters), kept)
    return Loop(program, source, dtype, state, list(parameters), kept)


def of_bench(dtype: str, sums: Callable = lambda machine, y, t, h: {}) -> Loop:
    """The loop of the pump bench of the benchmarks over the parameters in `VARIED`."""
    machine = bench_machine()
    start = {n: float(v) for n, v in machine.start().items()}
    return build(lambda p: varied(machine, p), start, list(VARIED), dtype, sums)


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
        y = {n: jnp.asarray(v, loop.dtype) for n, v in machine.start().items()}
        return jax.lax.fori_loop(0, steps, lambda i, y: step(ready, y, i.astype(loop.dtype) * h, h)[0], y)

    expected = jax.device_get(jax.jit(jax.vmap(one))(values))
    found = loop(values, steps, h)[0]
    worst = {n: np.abs(found[n] - e).max() / np.abs(e).max() for n, e in expected.items() if np.abs(e).max() > 0.0}
    return max(worst.values())


def rate(loop: Loop, batch: int, steps: int, threads: int, repeats: int = 5) -> float:
    """Design-steps per second, the best of some runs."""
    values, best = designs(batch, str(loop.dtype)), math.inf
    for _ in range(repeats):
        begin = time.perf_counter()
        loop(values, steps, DEFAULT_STEP, threads)
        best = min(best, time.perf_counter() - begin)
    return batch * steps / best


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
            for level, what in ((PARAMETER, "before the loop"), (TIME, "on time alone"), (STATE, "on the state")):
                counts = loop.program.count(level)
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
