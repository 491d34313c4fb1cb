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
    """What ptxas says of the kernel of a PTX text; `spilled` are the bytes a thread stores and loads."""

    registers: int
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


def assembled(ptx: str, architecture: str, most_registers: int = 255) -> Assembled:
    """The kernel compiled for an architecture such as "sm_90".

    Raises:
        RuntimeError: ptxas refuses the text; its words.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder) / "kernel.ptx", Path(folder) / "kernel.cubin"
        source.write_text(ptx)
        options = "-v", f"-arch={architecture}", f"-maxrregcount={most_registers}"
        done = subprocess.run([tool("ptxas"), *options, "-o", target, source], capture_output=True, text=True)
        words = done.stdout + done.stderr
        if done.returncode:
            raise RuntimeError(words)
        registers = re.search(r"Used (\d+) registers", words)
        spilled = re.search(r"(\d+) bytes spill stores, (\d+) bytes spill loads", words)
        return Assembled(int(registers[1]), (int(spilled[1]), int(spilled[2])), target.read_bytes())
