"""NVIDIA's assembler `ptxas` where it is installed: registers, spilled bytes and machine code of a kernel."""

import functools
import importlib.util
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import NamedTuple

MISSING = "NVIDIA's assembler ptxas is not installed (pip install nvidia-cuda-nvcc-cu12)"


class Assembled(NamedTuple):
    """What ptxas says of the kernel of a PTX text.

    Attributes:
        registers: of a thread.
        local_bytes: of memory that a thread has for what its registers cannot hold; a driver tells this number too.
        spilled: bytes that a thread stores there and loads from there, in all instructions of the kernel together.
        code: the machine code.
    """

    registers: int
    local_bytes: int
    spilled: tuple[int, int]
    code: bytes


@functools.cache
def tool(name: str) -> str | None:
    """The path of a program of the CUDA toolkit: on the search path, or in a package of Python."""
    found = shutil.which(name)
    spec = importlib.util.find_spec("nvidia")
    roots = [] if spec is None else [Path(root) for root in spec.submodule_search_locations or ()]
    packaged = sorted(path for root in roots for path in root.glob(f"*/bin/{name}"))
    return found or (str(packaged[0]) if packaged else None)


def assembled(ptx: str, architecture: str, most_registers: int = 255, more: tuple[str, ...] = ()) -> Assembled:
    """The kernel compiled for an architecture such as "sm_90", with `more` options for ptxas.

    Raises:
        RuntimeError: ptxas refuses the text; its words.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "kernel.ptx", Path(folder) / "kernel.cubin"
        source.write_text(ptx)
        options = "-v", f"-arch={architecture}", f"-maxrregcount={most_registers}", *more
        done = subprocess.run([tool("ptxas"), *options, "-o", target, source], capture_output=True, text=True)
        words = done.stdout + done.stderr
        if done.returncode:
            raise RuntimeError(words)
        registers = re.search(r"Used (\d+) registers", words)
        local = re.search(r"(\d+) bytes stack frame", words)
        spilled = re.search(r"(\d+) bytes spill stores, (\d+) bytes spill loads", words)
        return Assembled(int(registers[1]), int(local[1]), (int(spilled[1]), int(spilled[2])), target.read_bytes())


def loop_instructions(code: bytes) -> dict[str, int]:
    """The instructions of the step in machine code, which is its longest loop without another one inside, by kind.

    `all`, `fma` and `mufu` (special functions), and `double`, those that the units for float64 carry out.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "kernel.cubin"
        file.write_bytes(code)
        listing = subprocess.run([tool("nvdisasm"), "-c", file], capture_output=True, text=True, check=True).stdout
    labels: dict[str, int] = {}
    operations: list[str] = []
    branches: list[tuple[int, str]] = []
    for line in listing.splitlines():
        if found := re.match(r"\s*(\.L_\w+):", line):
            labels[found[1]] = len(operations)
        elif found := re.match(r"\s*/\*[0-9a-f]+\*/\s+(?:@!?U?P\w+\s+)?([A-Z][\w.]*)(.*)", line):
            if found[1].startswith("BRA") and (target := re.search(r"\((\.L_\w+)\)", found[2])):
                branches.append((len(operations), target[1]))
            operations.append(found[1])
    loops = [(labels[target], place) for place, target in branches if labels.get(target, place + 1) <= place]
    # a branch to itself ends the code
    loops = [(begin, end) for begin, end in loops if end > begin]
    inner = [a for a in loops if not any(b != a and a[0] <= b[0] and b[1] <= a[1] for b in loops)]
    begin, end = max(inner, key=lambda loop: loop[1] - loop[0])
    step = [operation for operation in operations[begin : end + 1] if operation != "NOP"]
    double = ("DFMA", "DADD", "DMUL", "DSETP", "DMNMX")
    return {
        "all": len(step), "fma": sum(o.split(".")[0] in ("FFMA", "DFMA", "FFMA2") for o in step),
        "mufu": sum(o.startswith("MUFU") for o in step), "double": sum(o.split(".")[0] in double for o in step),
    }  # fmt: skip
