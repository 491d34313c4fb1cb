"""What helps a GPU thread to keep its values in registers: variants of kernels, as NVIDIA's ptxas compiles them.

    python benchmarks/gpu_registers.py [--architecture sm_90]

No GPU is needed: registers and the bytes that a thread stores to memory and loads from it because registers are lacking
are told by ptxas, the instructions of a step by nvdisasm. In the first table values that a thread keeps over all steps
lie in shared memory; in the second the operations of forward mode with one direction are ordered in several ways, by
this package, by LLVM and by ptxas, and the sums of the metrics lie in shared memory. The last line sums up as
key=value.
"""

import argparse
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import jax

sys.path.insert(0, str(Path(__file__).parent.parent))

from edhas_jax.compiler.gpu import kernel as kernel_module  # noqa: E402
from edhas_jax.compiler.gpu.cuda_driver import CudaDriver  # noqa: E402
from edhas_jax.compiler.gpu.device_kernel import DeviceKernel  # noqa: E402
from edhas_jax.compiler.gpu.ptx import ptx  # noqa: E402
from edhas_jax.compiler.multi_jvp import multi_jvp  # noqa: E402
from edhas_jax.design.gradient import forward  # noqa: E402
from tests.support.fake_cuda import FakeCuda  # noqa: E402
from tests.support.loop_bodies import body_of  # noqa: E402
from tests.support.ptx_assembler import assembled, loop_instructions, tool  # noqa: E402

FORWARD = "forward, 1 direction"
THREADS = 128  # of a block, each of which has its own place in shared memory
LLVM_OPTIONS = ("--pre-RA-sched=list-burr", "--pre-RA-sched=list-ilp", "--pre-RA-sched=linearize", "--enable-misched",
                "--nvptx-sched4reg")  # fmt: skip
PTXAS_OPTIONS = ("-O1", "-O2", "--register-usage-level=0", "--register-usage-level=10")
FEW_USES = 2  # of a carried value that goes to shared memory: the sums of the metrics have one or two


def main() -> None:
    """Print both tables, then the headline figures as `key=value` pairs."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--architecture", default="sm_90")
    parser.add_argument("--llvm", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.llvm:
        return with_llvm_option(options.llvm)
    if not (tool("ptxas") and tool("nvdisasm")):
        sys.exit("ptxas and nvdisasm are needed: pip install nvidia-cuda-nvcc-cu12 nvidia-cuda-nvdisasm")
    version = subprocess.run([tool("ptxas"), "--version"], capture_output=True, text=True).stdout.splitlines()[-2]
    print(f"{options.architecture}, ptxas: {version}")
    table = Table(options.architecture)
    for name, dtype, most in (("pump", "float32", 128), ("pump", "float64", 255), ("system", "float32", 128)):
        text = text_of(name, dtype)
        table.row(f"{name}, {dtype}: as it is", ptx(text, "sm_80"), most)
        for each_use, when in ((False, "once a step"), (True, "at each use")):
            changed, count = lane_values_in_shared_memory(text, each_use)
            table.row(f"  {count} values in shared memory, read {when}", ptx(changed, "sm_80"), most)
    with mock.patch.object(kernel_module, "order_with_few_values", lambda given, *_: list(given)):
        with mock.patch.object(forward, "jax", ByElimination()):
            before = table.row("forward: vertex elimination, order of the trace", ptx(text_of(FORWARD), "sm_80"))
        table.row("  jax.jvp, order of the trace", ptx(text_of(FORWARD), "sm_80"))
    with mock.patch.object(forward, "jax", ByElimination()):
        table.row("  vertex elimination, order with few values", ptx(text_of(FORWARD), "sm_80"))
    text = text_of(FORWARD)
    now = table.row("  jax.jvp, order with few values: as it is", ptx(text, "sm_80"))
    for option in PTXAS_OPTIONS:
        table.row(f"  … with ptxas {option}", ptx(text, "sm_80"), options=(option,))
    for option in LLVM_OPTIONS:
        command = [sys.executable, __file__, f"--llvm={option}"]
        out = subprocess.run(command, capture_output=True, text=True, check=True, input=text).stdout
        table.row(f"  … with LLVM {option}", out)
    changed, count = carried_values_in_shared_memory(text)
    table.row(f"  … with {count} sums and tangents in shared memory", ptx(changed, "sm_80"))
    print(f"forward_loaded_before={before} forward_loaded={now}")


class Table:
    """Prints a row for each variant of a kernel."""

    def __init__(self, architecture: str):
        self._architecture = architecture
        print(f"{'variant':<58}{'registers':>10}{'memory B':>9}{'stored B':>9}{'loaded B':>9}{'per step':>9}")

    def row(self, name: str, text: str, most: int = 255, options: tuple[str, ...] = ()) -> int:
        """Compile a PTX text, print its row and return the bytes it loads."""
        found = assembled(text, self._architecture, most, options)
        step = loop_instructions(found.code)["all"]
        print(f"{name:<58}{found.registers:10}{found.local_bytes:9}{found.spilled[0]:9}{found.spilled[1]:9}{step:9}",
              flush=True)  # fmt: skip
        return found.spilled[1]


class ByElimination:
    """The module jax, with `jvp` by partial vertex elimination as for several tangents."""

    def __getattr__(self, name: str):
        return getattr(jax, name)

    @staticmethod
    def jvp(f: Callable, primals, tangents):
        """As `jax.jvp`."""
        value, (tangent,) = multi_jvp(f, primals, [tangents])
        return value, tangent


def text_of(name: str, dtype: str = "float64") -> str:
    """The LLVM text of a kernel."""
    body_of.cache_clear()
    return DeviceKernel(body_of(name, dtype), CudaDriver(FakeCuda())).text.kernel


def with_llvm_option(option: str) -> None:
    """Print the PTX of the text on standard input; an option of LLVM holds for the whole process."""
    from llvmlite import binding

    binding.set_option("", option)
    print(ptx(sys.stdin.read(), "sm_80"))


def lane_values_in_shared_memory(text: str, each_use: bool) -> tuple[str, int]:
    """A kernel whose values that differ from lane to lane but not from step to step lie in shared memory; how many."""
    kind, size = _kind(text)
    labels = "begin", "sample_loop", "step_loop", "sample_end"
    begin, loop, step, end = (text.index(f"\n{label}:") for label in labels)
    setup, body = text[begin:loop], text[step:end]
    wanted = []
    for name, code in re.findall(r"^\s*(%[\w.]+) = (.*)$", setup, re.MULTILINE):
        # a value without an address space lies in constant memory, from where an operand costs no register
        number = re.match(rf"(f\w+ {kind}|load {kind}, ptr addrspace|call {kind}|select i1 \S+ {kind})", code)
        if number and re.search(rf"{re.escape(name)}\b", body):
            wanted.append(name)
    stores = [f"  store volatile {kind} {name}, ptr addrspace(3) %place{k}, align {size}"
              for k, name in enumerate(wanted)]  # fmt: skip
    lines, loaded = [], {}
    for line in body.split("\n"):
        for k, name in enumerate(wanted):
            pattern = rf"{re.escape(name)}(?![\w.])"
            if re.search(pattern, line):
                if each_use or name not in loaded:
                    loaded[name] = f"%loaded{len(lines)}.{k}"
                    lines.append(f"  {loaded[name]} = load volatile {kind}, ptr addrspace(3) %place{k}, align {size}")
                line = re.sub(pattern, loaded[name], line)
        lines.append(line)
    text = text[:step] + "\n".join(lines) + text[end:]
    return _with_places(text, len(wanted), stores), len(wanted)


def carried_values_in_shared_memory(text: str) -> tuple[str, int]:
    """A kernel whose carried values that a step reads once or twice lie in shared memory; how many."""
    kind, size = _kind(text)
    step, end = (text.index(f"\n{label}:") for label in ("step_loop", "sample_end"))
    phis = re.findall(r"^\s*%c(\d+) = phi \w+ \[ %s\d+, %sample_begin \], \[ (\S+), %step_loop \]$",
                      text[step:end], re.MULTILINE)  # fmt: skip
    body = text[step:end]
    chosen = [(row, new) for row, new in phis if len(re.findall(rf"%c{row}\b", body)) <= 1 + FEW_USES]
    before = [f"  store volatile {kind} %s{row}, ptr addrspace(3) %place{k}, align {size}"
              for k, (row, _) in enumerate(chosen)]  # fmt: skip
    lines, loaded = [], set()
    for line in body.split("\n"):
        if any(line.strip().startswith(f"%c{row} = phi") for row, _ in chosen):
            continue
        for k, (row, _) in enumerate(chosen):
            if row not in loaded and re.search(rf"%c{row}\b", line):
                loaded.add(row)
                lines.append(f"  %c{row} = load volatile {kind}, ptr addrspace(3) %place{k}, align {size}")
        lines.append(line)
        for k, (_, new) in enumerate(chosen):
            if line.strip().startswith(f"{new} = "):
                lines.append(f"  store volatile {kind} {new}, ptr addrspace(3) %place{k}, align {size}")
    text = text[:step] + "\n".join(lines) + text[end:]
    text = text.replace("\n  br label %step_loop", "\n".join(["", *before, "  br label %step_loop"]), 1)
    return _with_places(text, len(chosen), []), len(chosen)


def _with_places(text: str, count: int, stores: list[str]) -> str:
    """A kernel with `count` places of each thread in shared memory, to which `stores` write at its beginning."""
    kind, size = _kind(text)
    array = f"@kept = internal addrspace(3) global [{count * THREADS} x {kind}] undef, align {size}\n"
    places = ["  %own = zext i32 %thread to i64"]
    for k in range(count):
        places += [f"  %index{k} = add i64 %own, {k * THREADS}",
                   f"  %place{k} = getelementptr {kind}, ptr addrspace(3) @kept, i64 %index{k}"]  # fmt: skip
    text = text.replace("\n  br label %sample_loop", "\n".join(["", *places, *stores, "  br label %sample_loop"]), 1)
    return text.replace("declare", array + "declare", 1)


def _kind(text: str) -> tuple[str, int]:
    """The type of the numbers of a kernel and its size in bytes."""
    return ("double", 8) if "double" in text else ("float", 4)


if __name__ == "__main__":
    main()
