"""Elementary functions in machine code against extended precision, and the identities that the scalar IR assumes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler.jaxpr_to_ir import Untranslatable
from edhas_jax.compiler.llvm_ops import Processor
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.native_loop import NativeLoop

EPS = {"float32": 2.0**-23, "float64": 2.0**-52}
BOTH_SIGNS = np.concatenate([-np.logspace(3, -8, 500), [0.0], np.logspace(-8, 3, 500)])
POSITIVE = np.logspace(-30, 30, 1000)
FUNCTIONS = {
    # name: (function, the same in NumPy, arguments, largest |error|/max(|f|, scale) in units of EPS, scale)
    "exp": (jnp.exp, np.exp, np.linspace(-80.0, 80.0, 2001), 0.8, 0.0),
    "expm1": (jnp.expm1, np.expm1, np.linspace(-20.0, 20.0, 2001), 1.2, 0.0),
    "log": (jnp.log, np.log, POSITIVE, 2.5, 1e-3),
    "log1p": (jnp.log1p, np.log1p, np.concatenate([-np.linspace(0, 0.99, 300), np.logspace(-9, 9, 600)]), 2.4, 0.0),
    "sin": (jnp.sin, np.sin, np.linspace(-50.0, 50.0, 3001), 0.8, 1.0),
    "cos": (jnp.cos, np.cos, np.linspace(-50.0, 50.0, 3001), 0.8, 1.0),
    "sin of large arguments": (jnp.sin, np.sin, np.linspace(-1e4, 1e4, 3001), 0.8, 1.0),
    "tanh": (jnp.tanh, np.tanh, BOTH_SIGNS, 2.3, 0.0),
    "logistic": (jax.nn.sigmoid, lambda x: 1 / (1 + np.exp(-x)), np.linspace(-30.0, 30.0, 1001), 1.6, 0.0),
    "sqrt": (jnp.sqrt, np.sqrt, POSITIVE, 1.5, 0.0),
    "inverse root": (jax.lax.rsqrt, lambda x: 1 / np.sqrt(x), POSITIVE, 1.3, 0.0),
    "fourth root": (lambda x: jnp.sqrt(jnp.sqrt(x)), lambda x: x**0.25, POSITIVE, 6, 0.0),
    "reciprocal": (lambda x: 1.0 / x, lambda x: 1 / x, POSITIVE, 1.0, 0.0),
    "power": (lambda x: x**1.37, lambda x: x ** np.longdouble(1.37), np.logspace(-3, 3, 500), 8.8, 0.0),
    "cube": (lambda x: x**-3, lambda x: 1 / x**3, np.logspace(-3, 3, 500), 3.7, 0.0),
    "sign": (jnp.sign, np.sign, BOTH_SIGNS, 0, 1.0),
    "abs": (jnp.abs, np.abs, BOTH_SIGNS, 0, 0.0),
    "clip": (lambda x: jnp.clip(x, -0.5, 2.0), lambda x: np.clip(x, -0.5, 2.0), BOTH_SIGNS, 0, 0.0),
    "where": (
        lambda x: jnp.where((x > 0.5) | ~(x < 2.0) & (x == x), x, -x), lambda x: np.where(x > 0.5, x, -x),
        BOTH_SIGNS, 0, 0.0,
    ),
}  # fmt: skip


def evaluate(f, x, dtype):
    """f(x) by a loop of one step."""
    body = LoopBody(lambda n, carry, lane, uniform: {"y": f(lane["x"])}, dtype, {"y": 0.0}, {"x": 0.0}, ())
    loop = NativeLoop(body)
    return loop({"y": np.zeros(len(x))}, {"x": x}, (), 0, 1)["y"]


@pytest.mark.parametrize("dtype", EPS)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_error_of_each_function_is_below_its_documented_bound(name, dtype):
    f, exact, x, bound, scale = FUNCTIONS[name]
    x = x.astype(dtype)
    expected = exact(x.astype(np.longdouble))
    error = np.abs(evaluate(f, x, dtype) - expected) / np.maximum(np.abs(expected), max(scale, 1e-300))
    assert error.max() <= bound * EPS[dtype], f"{error.max() / EPS[dtype]:.2f} ε at {x[error.argmax()]}"


@pytest.mark.parametrize("dtype", EPS)
def test_zero_infinity_and_not_a_number(dtype):
    special = np.array([0.0, np.inf, -1.0, np.nan])
    with np.errstate(all="ignore"):
        np.testing.assert_array_equal(evaluate(lambda x: 1.0 / x, special, dtype), [np.inf, 0.0, -1.0, np.nan])
        np.testing.assert_array_equal(evaluate(jnp.sqrt, special[[0, 2, 3]], dtype), [0.0, np.nan, np.nan])
        np.testing.assert_array_equal(evaluate(jnp.log, special[[0, 2, 3]], dtype), [-np.inf, np.nan, np.nan])
        finite = evaluate(lambda x: jnp.where(jnp.isfinite(x), 1.0, 0.0), special, dtype)
        np.testing.assert_array_equal(finite, [1.0, 0.0, 1.0, 0.0])


@pytest.mark.parametrize("dtype", EPS)
def test_exp_saturates_instead_of_overflowing_or_vanishing(dtype):
    low, high = {"float32": (-87.0, 88.0), "float64": (-708.0, 709.0)}[dtype]
    limits = evaluate(jnp.exp, np.array([low, high]), dtype)
    assert np.isfinite(limits).all() and limits[0] > 0.0
    np.testing.assert_array_equal(evaluate(jnp.exp, np.array([-np.inf, np.inf]), dtype), limits)
    np.testing.assert_array_equal(evaluate(lambda x: x**1.5, np.array([0.0]), dtype), limits[:1])
    np.testing.assert_array_equal(evaluate(jnp.tanh, np.array([-np.inf, np.inf]), dtype), [-1.0, 1.0])


@pytest.mark.parametrize("dtype", EPS)
def test_the_ir_takes_a_product_with_zero_and_a_difference_of_equals_as_zero(dtype):
    special = np.array([np.inf, np.nan, 2.0])
    for f in (lambda x: 0.0 * x, lambda x: x - x):
        np.testing.assert_array_equal(evaluate(f, special, dtype), [0.0, 0.0, 0.0])


def test_an_operation_without_counterpart_is_refused():
    for f in (lambda x: jnp.arctan2(x, x), lambda x: jnp.interp(x, jnp.arange(3.0), jnp.arange(3.0)), jnp.floor):
        with pytest.raises(Untranslatable):
            evaluate(f, np.ones(3), float)


def test_vector_width_follows_the_features_of_the_processor():
    assert Processor.from_features({"avx": True, "avx512f": False}) == Processor(32, False)
    assert Processor.from_features({}) == Processor(16, False) and Processor.from_features({}).lanes("float32") == 8
