"""The native engine: loops in machine code of this processor, compiled by LLVM through llvmlite."""

import functools
import platform

import jax
import numpy as np

from edhas_jax.compiler.loop_engine import AdjointLoop, Loop, LoopBody, LoopEngine
from edhas_jax.core import runtime


class NativeEngine(LoopEngine):
    """Loops in machine code; llvmlite is imported only when this engine is asked for."""

    name = "native"

    def unavailable(self) -> str:
        """See `LoopEngine.unavailable`."""
        if runtime.platform() != "cpu":
            return f"JAX computes on an accelerator here ({runtime.platform()}), where XLA serves"
        return processor_problem()

    def outside_scope(self, body: LoopBody) -> str:
        """See `LoopEngine.outside_scope`."""
        arrays = any(np.ndim(leaf) for leaf in jax.tree.leaves(body.uniform))
        return "the body reads an array, which registers cannot hold" if arrays else ""

    def compile(self, body: LoopBody) -> Loop:
        """See `LoopEngine.compile`."""
        from edhas_jax.compiler.native_loop import NativeLoop

        return NativeLoop(body)

    def compile_adjoint(self, body: LoopBody) -> AdjointLoop:
        """See `LoopEngine.compile_adjoint`."""
        from edhas_jax.compiler.native_adjoint import NativeAdjointLoop

        return NativeAdjointLoop(body)


@functools.cache
def processor_problem() -> str:
    """Why LLVM cannot compile for this processor; empty if it can."""
    try:
        from edhas_jax.compiler.llvm_jit import host
    except ImportError as error:
        return f"llvmlite cannot be imported ({error})"
    try:
        host()
    except Exception as error:  # LLVM reports an unknown processor in several ways
        return f"LLVM does not know this processor ({platform.machine()}: {error})"
    return ""
