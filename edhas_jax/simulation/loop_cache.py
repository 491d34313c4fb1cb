"""Compiled loops, made once for all machines of one structure."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from edhas_jax.compiler.engines import serving_engine
from edhas_jax.core import runtime
from edhas_jax.core.source_location import is_users_code
from edhas_jax.machine.rigs import Rig, components_by_name

# all that machine code is made from; editing anything else compiles nothing anew
LOOP_CODE = ("core/structs.py", "compiler", "machine", "simulation", "design/batch", "design/gradient")
MOST_LOOPS = 100  # kept at a time; each holds its machine code


def cached_loop(make: Callable, machine: Rig, *choices: Any, dtype=float) -> Any:
    """`make(machine, *choices)`, made once: `machine` counts only by its structure and the shapes of its leaves.

    Args:
        make: what compiles the loop; it gets a machine whose numbers have no meaning.
        machine: the machine to be run.
        choices: further arguments, hashable.
        dtype: floating-point type of the machine's numbers.
    """
    leaves, structure = jax.tree.flatten(machine)
    shapes = tuple(np.shape(leaf) for leaf in leaves)
    return _made(make, structure, shapes, choices, np.dtype(dtype), serving_engine().name)


def key_of(machine: Rig, *choices: Any) -> str | None:
    """A text for all that a loop depends on, so that it need not even be traced to be found in the cache.

    Args:
        machine: the machine; it counts by its structure.
        choices: what the loop is made for.

    Returns:
        The text; None where a part of the machine is not the package's own, so that its source is not known.
    """
    components = machine, *components_by_name(machine).values()
    if any(is_users_code(type(part)) for part in components):
        return None
    return " ".join(map(str, (jax.tree.structure(machine), *choices, runtime.code_hash(LOOP_CODE), jax.__version__)))


@functools.lru_cache(maxsize=MOST_LOOPS)
def _made(make: Callable, structure, shapes: tuple, choices: tuple, dtype, engine: str) -> Any:
    machine = jax.tree.unflatten(structure, [np.ones(shape, dtype) for shape in shapes])
    return make(machine, *choices)
