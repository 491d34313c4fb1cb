"""A GPU kernel's own text run on the processor, and a CUDA driver whose device memory is that of this process.

The text is changed in three places: the numbers of block and thread are read from variables that two loops set, the
approximate instructions of the GPU are functions, and the address spaces are one.
"""

import ctypes
import re
from collections.abc import Callable

import numpy as np

from edhas_jax.compiler.gpu.kernel import ARGUMENTS
from edhas_jax.compiler.llvm_jit import function

# what replaces an instruction; a subnormal argument counts as zero, as .ftz says
_INSTRUCTIONS = """
define {t} @rcp({t} %a) {{
  %b = call {t} @flushed({t} %a)
  %r = fdiv {t} 1.0, %b
  %e = fmul {t} %r, {error}
  ret {t} %e
}}
define {t} @rsqrt({t} %a) {{
  %b = call {t} @flushed({t} %a)
  %s = call {t} @llvm.sqrt.{f}({t} %b)
  %r = fdiv {t} 1.0, %s
  %e = fmul {t} %r, {error}
  ret {t} %e
}}
define {t} @sqrt({t} %a) {{
  %b = call {t} @flushed({t} %a)
  %s = call {t} @llvm.sqrt.{f}({t} %b)
  %e = fmul {t} %s, {error}
  ret {t} %e
}}
define {t} @flushed({t} %a) {{
  %magnitude = call {t} @llvm.fabs.{f}({t} %a)
  %small = fcmp olt {t} %magnitude, {tiny}
  %zero = call {t} @llvm.copysign.{f}({t} 0.0, {t} %a)
  %b = select i1 %small, {t} %zero, {t} %a
  ret {t} %b
}}
"""
_GRID = """
@ctaid = global i32 0
@ntid = global i32 0
@tid = global i32 0
define void @grid({parameters}, i32 %blocks, i32 %threads) {{
entry:
  store i32 %threads, ptr @ntid
  br label %each_block
each_block:
  %b = phi i32 [ 0, %entry ], [ %next_b, %block_end ]
  store i32 %b, ptr @ctaid
  br label %each_thread
each_thread:
  %t = phi i32 [ 0, %each_block ], [ %next_t, %each_thread ]
  store i32 %t, ptr @tid
  call void @run({parameters})
  %next_t = add i32 %t, 1
  %more_t = icmp slt i32 %next_t, %threads
  br i1 %more_t, label %each_thread, label %block_end
block_end:
  %next_b = add i32 %b, 1
  %more_b = icmp slt i32 %next_b, %blocks
  br i1 %more_b, label %each_block, label %exit
exit:
  ret void
}}
"""


def host_text(kernel: str, error: float = 0.0) -> str:
    """The module of a kernel as one for the processor, with the function grid(arguments…, blocks, threads).

    Args:
        kernel: the LLVM text of the kernel.
        error: relative error of every approximate instruction.
    """
    single = "asm" not in kernel or ".f32" in kernel
    t, f, dtype = ("float", "f32", np.float32) if single else ("double", "f64", np.float64)

    def number(value) -> str:
        return f"0x{np.float64(dtype(value)).view(np.uint64):016X}"

    text = re.sub(r"^target triple.*$", "", kernel, flags=re.MULTILINE)
    text = re.sub(r"^declare i32 @llvm\.nvvm\.read.*$", "", text, flags=re.MULTILINE)
    text = re.sub(r"call i32 @llvm\.nvvm\.read\.ptx\.sreg\.(\w+)\.x\(\)", r"load i32, ptr @\1", text)
    text = text.replace(" addrspace(1)", "").replace("ptx_kernel ", "")
    text = re.sub(r"byval\(.*?\) align \d+ ", "", text)
    text = re.sub(r'call (\w+) asm "(\w+)\.approx\.ftz\.\w+ .*?", ".*?"\(', r"call \1 @\2(", text)
    if "nvvm" in text or "asm" in text:
        raise ValueError("the kernel has an instruction of the GPU that this shim does not know")
    parameters = ", ".join(["ptr %constants", *(f"{k.split()[0]} %{n}" for n, k in ARGUMENTS.items())])
    text += _INSTRUCTIONS.format(t=t, f=f, error=number(1.0 + error), tiny=number(np.finfo(dtype).tiny))
    for name, count in (("sqrt", 1), ("fabs", 1), ("copysign", 2)):
        declaration = f"declare {t} @llvm.{name}.{f}({', '.join([t] * count)})"
        text += "" if declaration in text else f"\n{declaration}\n"
    return text + _GRID.format(parameters=parameters)


def host_kernel(kernel: str, error: float = 0.0) -> Callable:
    """grid(constants, *ARGUMENTS, blocks, threads) on the processor, all addresses and numbers as integers."""
    kinds = [ctypes.c_void_p if kind.startswith("ptr") else ctypes.c_int64 for kind in ARGUMENTS.values()]
    arguments = [ctypes.c_void_p, *kinds, ctypes.c_int32, ctypes.c_int32]
    return function(lambda: host_text(kernel, error), "grid", arguments)
