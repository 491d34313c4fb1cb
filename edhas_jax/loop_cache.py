"""Loops as machine code, made once for all machines of one structure."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from edhas_jax import backend
from edhas_jax.native import Untranslatable
from edhas_jax.system import Rig

KEPT = 32  # loops that are kept at a time; each holds its machine code


def loop_of(make: Callable, machine: Rig, *choices: Any, dtype=float) -> Any:
    """`make(machine, *choices)`, where `machine` counts only by its structure; None where XLA has to do it."""
    return _made(make, jax.tree.structure(machine), choices, np.dtype(dtype)) if backend.native_loops() else None


@functools.lru_cache(maxsize=KEPT)
def _made(make: Callable, structure, choices: tuple, dtype) -> Any:
    machine = jax.tree.unflatten(structure, [np.ones((), dtype)] * structure.num_leaves)
    try:
        return make(machine, *choices)
    except Untranslatable:
        return None
