"""From LLVM assembly to a function in this process, by way of a cache of object files."""

import ctypes
import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import llvmlite
from llvmlite import binding as llvm

from edhas_jax.compiler.llvm_ops import Processor
from edhas_jax.core.atomic_file import atomic_write


class Host(NamedTuple):
    """The processor at hand, as LLVM knows it."""

    name: str
    features: str
    processor: Processor


@functools.cache
def host() -> Host:
    """The processor at hand."""
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    features = llvm.get_host_cpu_features()
    return Host(llvm.get_host_cpu_name(), features.flatten(), Processor.from_features(features))


def function(
    assembly: Callable[[], str], name: str, arguments: list, cache: Path | None = None, key: str | None = None
) -> Callable:
    """The function `name` of a module as a callable without result, for `arguments` of types of ctypes.

    The object file is kept in the folder `cache` and taken from there the next time: where a `key` stands for the
    assembly, without asking for it.
    """
    here = host()
    text = assembly() if key is None else key
    digest = hashlib.sha256("\n".join((text, here.name, here.features, llvmlite.__version__)).encode()).hexdigest()
    kept = None if cache is None else cache / f"loop-{digest[:32]}.o"
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=here.name, features=here.features, opt=3, reloc="pic", codemodel="jitdefault"
    )
    if kept is not None and kept.exists():
        code = kept.read_bytes()
    else:
        module = llvm.parse_assembly(text if key is None else assembly())
        module.verify()
        code = machine.emit_object(module)
        if kept is not None:
            _keep(kept, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
    engine.finalize_object()
    call = ctypes.CFUNCTYPE(None, *arguments)(engine.get_function_address(name))
    call.engine = engine  # the code lives as long as its engine
    return call


def _keep(path: Path, code: bytes) -> None:
    """Write a file that is either whole or not there; a cache that cannot be written is no reason to stop."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as beside:
            beside.write_bytes(code)
    except OSError:
        pass
