"""From LLVM assembly to a function in this process, by way of a cache of object files."""

import ctypes
import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import llvmlite
from llvmlite import binding as llvm

from edhas_jax.compiler.llvm_ops import Processor
from edhas_jax.compiler.object_cache import ObjectCache


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

    The object file is kept in the folder `cache` (see `ObjectCache`) and taken from there the next time: where a `key`
    stands for the assembly, without asking for it.
    """
    here = host()
    text = assembly() if key is None else key
    identity, kept = "\n".join((text, here.name, here.features, llvmlite.__version__)), ObjectCache(cache)
    machine = llvm.Target.from_default_triple().create_target_machine(
        cpu=here.name, features=here.features, opt=3, reloc="pic", codemodel="jitdefault"
    )
    code = kept.read(identity)
    if code is None:
        module = llvm.parse_assembly(text if key is None else assembly())
        module.verify()
        code = machine.emit_object(module)
        kept.keep(identity, code)
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.object_file.ObjectFileRef.from_data(code))
    engine.finalize_object()
    call = ctypes.CFUNCTYPE(None, *arguments)(engine.get_function_address(name))
    call.engine = engine  # the code lives as long as its engine
    return call
