"""From LLVM assembly to PTX, the portable assembly of NVIDIA GPUs, which their driver compiles for the GPU at hand."""

import functools
from pathlib import Path

import llvmlite
from llvmlite import binding as llvm

from edhas_jax.compiler.object_cache import ObjectCache

TRIPLE = "nvptx64-nvidia-cuda"


def target(capability: tuple[int, int]) -> str:
    """The oldest GPU whose PTX serves as well for one of this compute capability; newer ones take older PTX."""
    return "sm_80" if capability >= (8, 0) else "sm_70"


def ptx_problem() -> str:
    """Why LLVM cannot write PTX; empty if it can."""
    try:
        _machine("sm_80")
    except RuntimeError as error:
        return f"this llvmlite cannot compile for NVIDIA GPUs ({error})"
    return ""


@functools.cache
def _machine(name: str) -> llvm.TargetMachine:
    llvm.initialize_all_targets()
    llvm.initialize_all_asmprinters()
    return llvm.Target.from_triple(TRIPLE).create_target_machine(cpu=name, opt=3)


def ptx(kernel: str, name: str, cache: Path | None = None) -> str:
    """The PTX of a kernel for the target `name`; kept in the folder `cache` and taken from there the next time."""
    identity, kept = "\n".join((kernel, name, llvmlite.__version__)), ObjectCache(cache)
    found = kept.read(identity)
    if found is not None:
        return found.decode()
    module = llvm.parse_assembly(kernel)
    module.verify()
    text = _machine(name).emit_assembly(module)
    kept.keep(identity, text.encode())
    return text
