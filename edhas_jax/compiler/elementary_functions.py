"""Elementary functions in terms of the operations of a program: argument reduction and a polynomial.

The errors are a few units in the last place over the whole range; `tests/test_native.py` measures them.
"""

import math
from collections.abc import Sequence

import numpy as np

from edhas_jax.compiler.scalar_ir import Program

# added and taken away again, it rounds a number to a whole one
_ROUNDING = {np.float32: 1.5 * 2.0**23, np.float64: 1.5 * 2.0**52}
# ln 2 and π/2 in parts, of which all but the last have room for a factor
_LN2 = {np.float32: (0.693359375, -2.12194440e-4), np.float64: (6.93145751953125e-1, 1.42860682030941723212e-6)}
_HALF_PI = {
    np.float32: (1.5703125, 4.837512969970703e-4, 7.549789948768648e-8),
    np.float64: (1.57079625129699707031, 7.54978941586159635335e-8, 5.39030285815811905290e-15),
}
_EXP_RANGE = {np.float32: (-87.0, 88.0), np.float64: (-708.0, 709.0)}
_EXP_TERMS = {np.float32: 8, np.float64: 14}
_LOG_TERMS = {np.float32: 5, np.float64: 12}
_SINE_TERMS = {np.float32: 5, np.float64: 9}


def _polynomial(p: Program, x: int, coefficients: Sequence[float]) -> int:
    out = p.const(coefficients[-1])
    for c in coefficients[-2::-1]:
        out = p.add(p.mul(out, x), p.const(c))
    return out


def _reduced(p: Program, x: int, step: float, parts: Sequence[float]) -> tuple[int, int]:
    """n and x − n · step, n whole, with `step` given in parts."""
    big = p.const(_ROUNDING[p.type])
    n = p.sub(p.add(p.mul(x, p.const(1.0 / step)), big), big)
    for part in parts:
        x = p.sub(x, p.mul(n, p.const(part)))
    return n, x


def _exp_parts(p: Program, x: int) -> tuple[int, int]:
    """2ⁿ and eʳ − 1 with eˣ = 2ⁿ eʳ; x is taken to the range in which eˣ is a normal number."""
    low, high = _EXP_RANGE[p.type]
    n, r = _reduced(p, p.extreme("max", p.extreme("min", x, p.const(high)), p.const(low)), math.log(2.0), _LN2[p.type])
    tail = _polynomial(p, r, [1.0 / math.factorial(k) for k in range(2, _EXP_TERMS[p.type])])
    return p.unary("power_of_two", n), p.add(r, p.mul(p.mul(r, r), tail))


def exp(p: Program, x: int) -> int:
    """eˣ"""
    scale, rest = _exp_parts(p, x)
    return p.add(scale, p.mul(scale, rest))


def expm1(p: Program, x: int) -> int:
    """eˣ − 1, exact near 0"""
    scale, rest = _exp_parts(p, x)
    return p.add(p.mul(scale, rest), p.sub(scale, p.const(1.0)))


def tanh(p: Program, x: int) -> int:
    """tanh x"""
    size = p.extreme("min", p.unary("abs", x), p.const(20.0))
    e = expm1(p, p.add(size, size))
    t = p.mul(e, p.reciprocal(p.add(e, p.const(2.0))))
    return p.select(p.compare("lt", x, p.const(0.0)), p.neg(t), t)


def logistic(p: Program, x: int) -> int:
    """1/(1 + e⁻ˣ)"""
    return p.reciprocal(p.add(p.const(1.0), exp(p, p.neg(x))))


def _log(p: Program, u: int, lost: int) -> int:
    """ln(u + lost) for a `lost` far below u."""
    k = p.unary("exponent", u)
    scale = p.unary("power_of_two", p.neg(k))
    f = p.add(p.sub(p.mul(u, scale), p.const(1.0)), p.mul(lost, scale))
    s = p.mul(f, p.reciprocal(p.add(p.const(2.0), f)))
    series = _polynomial(p, p.mul(s, s), [2.0 / (2 * k + 1) for k in range(_LOG_TERMS[p.type])])
    out = p.add(p.mul(k, p.const(math.log(2.0))), p.mul(s, series))
    zero = p.const(0.0)
    beyond = p.select(p.compare("eq", u, zero), p.const(-math.inf), p.const(math.nan))
    return p.select(p.compare("gt", u, zero), out, beyond)


def log(p: Program, x: int) -> int:
    """ln x"""
    return _log(p, x, p.const(0.0))


def log1p(p: Program, x: int) -> int:
    """ln(1 + x), exact near 0"""
    u = p.add(p.const(1.0), x)
    return _log(p, u, p.sub(x, p.sub(u, p.const(1.0))))


def power(p: Program, x: int, y: int) -> int:
    """x^y for x ≥ 0"""
    return exp(p, p.mul(y, log(p, x)))


def _turn(p: Program, x: int) -> tuple[int, int, int]:
    """Sine and cosine of what is left of x after whole quarter turns, and their number from −2 to 2."""
    n, r = _reduced(p, x, 0.5 * math.pi, _HALF_PI[p.type])
    quarter, _ = _reduced(p, n, 4.0, ())
    q, terms = p.mul(r, r), _SINE_TERMS[p.type]
    of_sine = _polynomial(p, q, [(-1) ** k / math.factorial(2 * k + 1) for k in range(1, terms)])
    of_cosine = _polynomial(p, q, [(-1) ** k / math.factorial(2 * k) for k in range(1, terms + 1)])
    sine, cosine = p.add(r, p.mul(p.mul(r, q), of_sine)), p.add(p.const(1.0), p.mul(q, of_cosine))
    return sine, cosine, p.sub(n, p.mul(p.const(4.0), quarter))


def _in_quadrant(p: Program, n: int, even: int, odd: int) -> int:
    """`even` after no quarter turn and −`even` after two; `odd` after one and −`odd` after minus one."""
    size = p.unary("abs", n)
    even = p.select(p.compare("lt", size, p.const(0.5)), even, p.neg(even))
    odd = p.select(p.compare("gt", n, p.const(0.0)), odd, p.neg(odd))
    return p.select(p.compare("eq", size, p.const(1.0)), odd, even)


def sin(p: Program, x: int) -> int:
    """sin x"""
    sine, cosine, n = _turn(p, x)
    return _in_quadrant(p, n, sine, cosine)


def cos(p: Program, x: int) -> int:
    """cos x"""
    sine, cosine, n = _turn(p, x)
    return _in_quadrant(p, n, cosine, p.neg(sine))
