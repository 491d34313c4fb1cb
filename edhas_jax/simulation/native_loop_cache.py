"""Loops as machine code, made once for all machines of one structure."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from edhas_jax.compiler.jaxpr_to_ir import Untranslatable
from edhas_jax.core import runtime
from edhas_jax.machine.rigs import Rig, components_by_name

# all that the text of a loop is made from; editing anything else compiles nothing anew
LOOP_CODE = ("core/structs.py", "compiler", "machine", "simulation", "design/batch")
KEPT = 32  # loops that are kept at a time; each holds its machine code


def loop_of(make: Callable, machine: Rig, *choices: Any, dtype=float) -> Any:
    """`make(machine, *choices)`, where `machine` counts only by its structure; None where XLA has to do it."""
    return _made(make, jax.tree.structure(machine), choices, np.dtype(dtype)) if runtime.native_loops() else None


def key_of(machine: Rig, *choices: Any) -> str | None:
    """A text for all that a loop depends on, so that it need not even be traced to be found.

    `choices` say what it is of the machine; None where a part of the machine is not the package's own.
    """
    components = components_by_name(machine).values()
    if any(not type(part).__module__.startswith("edhas_jax.") for part in (machine, *components)):
        return None
    return " ".join(map(str, (jax.tree.structure(machine), *choices, runtime.code_hash(LOOP_CODE), jax.__version__)))


@functools.lru_cache(maxsize=KEPT)
def _made(make: Callable, structure, choices: tuple, dtype) -> Any:
    machine = jax.tree.unflatten(structure, [np.ones((), dtype)] * structure.num_leaves)
    try:
        return make(machine, *choices)
    except Untranslatable:
        return None
