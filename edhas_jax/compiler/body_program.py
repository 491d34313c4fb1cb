"""The body of a loop as a scalar program, with the place where each of its inputs comes from."""

from collections.abc import Mapping
from typing import NamedTuple

import jax
import numpy as np

from edhas_jax.compiler.jaxpr_to_ir import trace_to_ir
from edhas_jax.compiler.loop_engine import LoopBody
from edhas_jax.compiler.program_code import InputSource
from edhas_jax.compiler.scalar_ir import Dependence, Program
from edhas_jax.core import runtime

_DEPENDENCE = {
    "carry": Dependence.CARRY,
    "lane": Dependence.INVARIANT,
    "uniform": Dependence.INVARIANT,
    "sample_inputs": Dependence.SAMPLE,
}


class BodyProgram(NamedTuple):
    """One step of a loop.

    Attributes:
        program: its output k is row k of the new carry.
        sources: where each input of the program comes from.
        rows: the number of rows of "carry", "lane", "uniform" and, where the body has them, "sample_inputs".
    """

    program: Program
    sources: list[InputSource]
    rows: Mapping[str, int]


def body_program(body: LoopBody) -> BodyProgram:
    """Trace a body.

    Raises:
        Untranslatable: it uses an operation that has no counterpart in the scalar IR.
        ValueError: it turns the carry into another structure.
    """
    structures = {name: jax.tree.structure(tree) for name, tree in body.inputs.items()}
    depends = [jax.tree.map(lambda _, n=n: _DEPENDENCE[n], tree) for n, tree in body.inputs.items()]
    if body.tangents is not None:
        kinds = {False: Dependence.CARRY, True: Dependence.TANGENT}
        depends[0] = jax.tree.map(kinds.__getitem__, body.tangents)
    with runtime.double_precision():
        program, out = trace_to_ir(body.step, np.dtype(body.dtype), Dependence.STEP, *depends)
    if out != structures["carry"]:
        raise ValueError(f"the body turns {structures['carry']} into {out}")
    rows = {name: structure.num_leaves for name, structure in structures.items()}
    inputs = (InputSource(name, row) for name, count in rows.items() for row in range(count))
    return BodyProgram(program, [InputSource("step"), *inputs], rows)
