"""The kernel of a loop: its text on the processor against the native engine, and what its PTX may contain."""

import dataclasses
import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler import native_loop
from edhas_jax.compiler.gpu import device_kernel
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver
from edhas_jax.compiler.gpu.device_kernel import DeviceKernel
from edhas_jax.compiler.gpu.kernel import ARGUMENTS
from edhas_jax.compiler.gpu.loop import GpuLoop
from edhas_jax.compiler.gpu.ptx import ptx
from edhas_jax.compiler.llvm_jit import host
from edhas_jax.compiler.llvm_ops import Processor
from edhas_jax.compiler.loop_engine import LoopBody, Untranslatable
from edhas_jax.compiler.native_loop import NativeLoop
from tests.compiler.test_elementary_functions import EPS, FUNCTIONS
from tests.support.fake_cuda import FakeCuda, fake_engine
from tests.support.loop_bodies import NAMES, body_of, pump_lanes

# the largest relative error of the instructions in float32 (PTX ISA) and, in float64, one that Newton's two iterations
# still make good
WORST = {"float32": 2.0**-22.9, "float64": 2.0**-16}


@pytest.fixture
def gpu_loop(monkeypatch):
    """`gpu_loop(body, error)`: a loop on a simulated GPU whose approximate instructions have this relative error."""

    def made(body: LoopBody, error: float = 0.0) -> GpuLoop:
        engine = fake_engine(monkeypatch, FakeCuda(error=error))
        return engine.compile(body)

    return made


def with_exact_instructions(assembly: str) -> str:
    """Assembly for AVX-512 with one lane, with exact values in place of its approximations of 1/x and 1/√x."""
    text = assembly.replace("@llvm.x86.avx512.", "@exact.")
    kinds = {"rcp14": "", "rsqrt14": "%a = call <1 x double> @llvm.sqrt.v1f64(<1 x double> %0)\n"}
    for name, first in kinds.items():
        body = f"{first}%r = fdiv <1 x double> <double 1.0>, {'%a' if first else '%0'}\nret <1 x double> %r"
        text = re.sub(rf"declare (.* @exact\.{name}\..*)\(.*\)",
                      rf"define \1(<1 x double> %0, <1 x double> %1, i1 %2) {{\n{body}\n}}", text)  # fmt: skip
    declaration = "declare <1 x double> @llvm.sqrt.v1f64(<1 x double>)"
    return text if declaration in text else f"{declaration}\n{text}"


@pytest.fixture
def exact(monkeypatch):
    """The native engine computes 1/x and 1/√x as the kernel does where its instructions make no error."""

    def use(dtype: str) -> None:
        processor = Processor(16, False) if dtype == "float32" else Processor(8, True)
        here = host()._replace(processor=processor)
        monkeypatch.setattr(native_loop, "host", lambda: here)
        monkeypatch.setattr(device_kernel, "host", lambda: here)
        write, function = native_loop.loop_assembly, native_loop.function
        if dtype == "float64":
            monkeypatch.setattr(native_loop, "loop_assembly", lambda *a: with_exact_instructions(write(*a)))
            compiled = device_kernel.function
            monkeypatch.setattr(
                device_kernel, "function", lambda text, *a: compiled(lambda: with_exact_instructions(text()), *a)
            )
        # neither is taken from the cache by the key of the body
        monkeypatch.setattr(native_loop, "function", lambda text, name, kinds, *_: function(text, name, kinds))

    return use


@pytest.mark.parametrize("dtype", EPS)
def test_the_kernel_equals_the_native_engine_to_the_bit(dtype, gpu_loop, exact):
    """A whole cycle of pump benches with their metrics, samples kept, where the approximations make no error."""
    exact(dtype)
    body, lanes = body_of("pump", dtype), pump_lanes(150, dtype)
    ours = gpu_loop(body).run(*lanes, 0, 256, 8)
    theirs = NativeLoop(dataclasses.replace(body, key=None)).run(*lanes, 0, 256, 8)
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(theirs.samples[0]))
    jax.tree.map(np.testing.assert_array_equal, ours, theirs)


@pytest.mark.parametrize("dtype", EPS)
@pytest.mark.parametrize("name", FUNCTIONS)
def test_error_of_each_function_with_the_worst_approximations(name, dtype, gpu_loop):
    """At most 3.5 ε, and 6 ε in float32, where a reciprocal is used as the instruction gives it."""
    f, right, x, bound, scale = FUNCTIONS[name]
    limit = max(bound, {"float32": 6.0, "float64": 3.5}[dtype]) if bound else 0.0
    x = x.astype(dtype)
    expected = right(x.astype(np.longdouble))
    body = LoopBody(lambda n, carry, lane, uniform: {"y": f(lane["x"])}, dtype, {"y": 0.0}, {"x": 0.0}, ())
    for error in (-WORST[dtype], 0.0, WORST[dtype]):
        found = gpu_loop(body, error)({"y": np.zeros(len(x))}, {"x": x}, (), 0, 1)["y"]
        off = np.abs(found - expected) / np.maximum(np.abs(expected), max(scale, 1e-300))
        assert off.max() <= limit * EPS[dtype], f"{off.max() / EPS[dtype]:.2f} ε at {x[off.argmax()]}, error {error}"


@pytest.mark.parametrize("dtype", EPS)
def test_zero_infinity_and_not_a_number(dtype, gpu_loop):
    special = np.array([0.0, np.inf, -1.0, np.nan])

    def values(f, x):
        body = LoopBody(lambda n, carry, lane, uniform: {"y": f(lane["x"])}, dtype, {"y": 0.0}, {"x": 0.0}, ())
        return gpu_loop(body)({"y": np.zeros(len(x))}, {"x": x}, (), 0, 1)["y"]

    np.testing.assert_array_equal(values(lambda x: 1.0 / x, special), [np.inf, 0.0, -1.0, np.nan])
    np.testing.assert_array_equal(values(jnp.sqrt, special[[0, 2, 3]]), [0.0, np.nan, np.nan])
    np.testing.assert_array_equal(values(jnp.log, special[[0, 2, 3]]), [-np.inf, np.nan, np.nan])


@pytest.mark.parametrize("dtype", EPS)
def test_metrics_with_the_worst_approximations_are_those_of_the_native_engine(dtype, gpu_loop):
    """A cycle of 2048 steps: the sums of a metric differ by less than a thousandth of the step's own error."""
    body, lanes = body_of("pump", dtype), pump_lanes(64, dtype)
    right = NativeLoop(body)(*lanes, 0, 2048)
    for error in (-WORST[dtype], WORST[dtype]):
        found = gpu_loop(body, error)(*lanes, 0, 2048)
        for name, expected in right[1].items():
            scale = np.abs(expected).max()
            limit = {"float32": 1e-3, "float64": 1e-9}[dtype] * scale
            np.testing.assert_allclose(found[1][name], expected, rtol=0.0, atol=limit, err_msg=name)


@pytest.mark.parametrize(
    ("name", "dtype"), [*((n, "float64") for n in NAMES), ("pump", "float32"), ("system", "float32")]
)
def test_ptx_rounds_every_operation_and_calls_nothing(name, dtype):
    """Sums and products name their rounding, so that ptxas contracts none; no function of a library is needed."""
    text = ptx_of(name, dtype)
    assert not re.findall(r"\b(?:add|sub|mul|fma)\.(?:ftz\.)?f\d\d\b", text)
    assert not re.findall(r"\b(?:call|\.extern|div|sqrt\.rn|rcp\.rn)\b.*", text)
    assert {"float32": ".f64", "float64": ".f32"}[dtype] not in text
    approximate = set(re.findall(r"\b\w+\.approx\.ftz\.f\d\d\b", text))
    allowed = {"rcp", "rsqrt", "sqrt"} if dtype == "float32" else {"rcp", "rsqrt"}
    assert approximate <= {f"{n}.approx.ftz.f{dtype[-2:]}" for n in allowed}


@pytest.mark.parametrize("name", NAMES)
def test_ptx_takes_the_arguments_that_the_launcher_passes(name):
    """The constants as one block, then every argument in 8 bytes, in the launcher's order."""
    kernel, text = kernel_of(name, "float64"), ptx_of(name, "float64")
    (head,) = re.findall(r"\.entry run\((.*?)\)\s", text, re.DOTALL)
    block, *others = (parameter.strip() for parameter in head.split(","))
    assert re.fullmatch(rf"\.param \.align 8 \.b8 run_param_0\[{8 * max(kernel.text.count, 1)}\]", block)
    kinds = [re.match(r"\.param \.([ub]64)\b", parameter)[1] for parameter in others]
    assert len(kinds) == len(ARGUMENTS) and set(kinds) <= {"u64", "b64"}


def test_too_many_constants_are_refused():
    def body(n, carry, lane, uniform):
        return sum((jnp.sin(carry * u) for u in uniform), carry)

    with pytest.raises(Untranslatable, match="the same for all lanes"):
        DeviceKernel(LoopBody(body, float, 0.0, {}, tuple([0.0] * 500)), CudaDriver(FakeCuda()))


@functools.cache
def kernel_of(name: str, dtype: str) -> DeviceKernel:
    body = dataclasses.replace(body_of(name, dtype), dtype=dtype)
    return DeviceKernel(body, CudaDriver(FakeCuda()), backwards=name == "reverse")


@functools.cache
def ptx_of(name: str, dtype: str) -> str:
    return ptx(kernel_of(name, dtype).text.kernel, "sm_80")
