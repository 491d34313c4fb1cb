"""LLVM assembly of the operations of a scalar program for one thread of a GPU; every value is one scalar register.

Sums, products and fused multiply-adds round as on a processor, subnormal numbers included. Reciprocals and roots start
from the approximations of the GPU, which take a subnormal argument for zero and flush a subnormal result to zero:

=========  ==================================================  ===================================================
           float32                                             float64
=========  ==================================================  ===================================================
1/x        `rcp.approx.ftz.f32`, error at most 2⁻²³            `rcp.approx.ftz.f64`, then Newton's iteration twice
√x         `sqrt.approx.ftz.f32`, error at most 2⁻²³           x · 1/√x
1/√x       `rsqrt.approx.ftz.f32`, error at most 2⁻²²·⁹        `rsqrt.approx.ftz.f64`, then Newton twice
x^(−1/4)   1/√ of √x                                           `rsqrt.approx.ftz.f64` of it and of x, then Newton
=========  ==================================================  ===================================================

Errors of the instructions are those that NVIDIA states (PTX ISA, floating-point instructions). For the approximations
in float64 NVIDIA states only that they read the upper 32 bits of the argument, which hold 20 bits of its mantissa; two
iterations are enough if the relative error of the approximation is at most 2⁻¹⁶.
"""

import numpy as np

from edhas_jax.compiler.llvm_ops import Processor, VectorCode


class ThreadCode(VectorCode):
    """As `VectorCode`, with one number in each register and the instructions of an NVIDIA GPU."""

    def __init__(self, dtype):
        super().__init__(dtype, Processor(np.dtype(dtype).itemsize, has_approximations=True, vectors=1))
        self.vector, self.mask, self.integer_vector = self.scalar, "i1", self.integer
        self._suffix = f"f{8 * self.dtype.itemsize}"
        self._single = self.scalar == "float"

    def constant(self, text: str) -> str:
        """A typed LLVM constant; instructions name its type themselves."""
        return text.split(" ", 1)[1]

    def splat(self, scalar: str) -> str:
        """The register itself."""
        return scalar

    def approximation(self, name: str, a: str) -> str:
        """1/a (`rcp14`) or 1/√a (`rsqrt14`) by an instruction of the GPU; in float64 Newton's iteration follows."""
        return self.instruction(f"{name.removesuffix('14')}.approx.ftz", a)

    def instruction(self, name: str, a: str) -> str:
        """The result of an instruction of the GPU that LLVM has no operation for."""
        kind, letter = ("f32", "f") if self._single else ("f64", "d")
        return self.assign(f'call {self.scalar} asm "{name}.{kind} $0, $1;", "={letter},{letter}"({self.scalar} {a})')

    def reciprocal(self, a: str) -> str:
        """1/a."""
        return self.approximation("rcp14", a) if self._single else super().reciprocal(a)

    def inverse_root(self, a: str) -> str:
        """1/√a."""
        return self.approximation("rsqrt14", a) if self._single else super().inverse_root(a)

    def root(self, a: str) -> str:
        """√a."""
        return self.instruction("sqrt.approx.ftz", a) if self._single else super().root(a)

    def inverse_fourth_root(self, a: str) -> str:
        """a^(−1/4)."""
        return self.inverse_root(self.root(a)) if self._single else super().inverse_fourth_root(a)
