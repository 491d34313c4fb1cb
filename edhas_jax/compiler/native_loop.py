"""A loop over time for many lanes, compiled for this processor."""

import ctypes
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import jax
import numpy as np

from edhas_jax.compiler.jaxpr_to_ir import trace_to_ir
from edhas_jax.compiler.llvm_jit import function, host
from edhas_jax.compiler.llvm_loop import InputSource, loop_assembly
from edhas_jax.compiler.scalar_ir import Dependence
from edhas_jax.compiler.threads import each

_LEVELS = {
    "carry": Dependence.CARRY,
    "lane": Dependence.INVARIANT,
    "uniform": Dependence.INVARIANT,
    "sample_inputs": Dependence.SAMPLE,
}


class Marched(NamedTuple):
    """What a loop leaves behind: the last carry, and those before every stretch with the samples as first axis."""

    carry: Any
    kept: Any


class Loop:
    """carry ← body(n, carry, lane, uniform) for n = first, first + 1, …: for each lane on its own.

    `body` is a JAX function of scalars. `carry`, `lane` (what differs from lane to lane) and `uniform` (what does not)
    are pytrees of real scalars; the examples given here count only by their structure. With `fed`, another pytree of
    what changes from sample to sample, the body has it as a fifth argument; `backwards` goes through the samples from
    the last to the first; `vectors` are marched side by side, two where nothing is said. `tangents`, of the structure
    of `carry`, is true where a leaf is a derivative: what depends on one is computed in the order of the body.
    Changing any number compiles nothing. With a `cache` the machine code is kept; a `key` stands for all that the body
    depends on, its own text included, and saves even looking at it. The numbers of a lane depend on that lane alone, to
    the bit, not on its place or on the number of threads.

    Raises:
        Untranslatable: the body uses an operation that is not known here.
    """

    def __init__(
        self, body: Callable, dtype, carry: Any, lane: Any, uniform: Any, cache: Path | None = None,
        key: str | None = None, fed: Any = None, backwards: bool = False, vectors: int | None = None,
        tangents: Any = None,
    ):  # fmt: skip
        self.dtype = np.dtype(dtype)
        processor = host().processor
        if vectors is not None:
            processor = dataclasses.replace(processor, vectors=vectors)
        tables = {"carry": carry, "lane": lane, "uniform": uniform} | ({} if fed is None else {"sample_inputs": fed})
        self._structures = {name: jax.tree.structure(table) for name, table in tables.items()}

        def text() -> str:
            levels = [jax.tree.map(lambda _, name=name: _LEVELS[name], table) for name, table in tables.items()]
            if tangents is not None:
                levels[0] = jax.tree.map(lambda tangent: Dependence.TANGENT if tangent else Dependence.CARRY, tangents)
            program, out = trace_to_ir(body, self.dtype, Dependence.STEP, *levels)
            if out != self._structures["carry"]:
                raise ValueError(f"the body turns {self._structures['carry']} into {out}")
            rows = {name: structure.num_leaves for name, structure in self._structures.items()}
            leaves = ((name, row) for name, count in rows.items() for row in range(count))
            sources = [InputSource("step"), *(InputSource(*leaf) for leaf in leaves)]
            counts = rows["carry"], rows["lane"], rows.get("sample_inputs", 0)
            return loop_assembly(program, processor, sources, *counts, backwards)

        self.lanes = processor.lanes(self.dtype)
        self._code = function(text, "run", [ctypes.c_void_p] * 5 + [ctypes.c_int64] * 4, cache, key)

    def __call__(self, carry: Any, lane: Any, uniform: Any, first: int, steps: int, threads: int = 1) -> Any:
        """The carry after `steps` steps; leaves of `carry` and `lane` have the shape (lanes,)."""
        return self.march(carry, lane, uniform, first, steps, 1, threads, keep=False).carry

    def march(
        self, carry: Any, lane: Any, uniform: Any, first: int, per_sample: int, samples: int, threads: int = 1,
        keep: bool = True, fed: Any = None,
    ) -> Marched:  # fmt: skip
        """`samples` stretches of `per_sample` steps, the carry being kept before each: leaves (samples, lanes).

        Leaves of `fed` have the shape (samples,): they are the same for all lanes.
        """
        count = np.shape(jax.tree.leaves(carry)[0])[0]
        state, fixed = self.blocks("carry", carry, count), self.blocks("lane", lane, count)
        scalars = self.scalars(uniform)
        blocks, rows, _ = state.shape
        kept = np.empty((blocks, samples, rows, self.lanes) if keep else 0, self.dtype)
        feed = np.empty(0, self.dtype)
        if fed is not None:
            columns = np.stack([np.asarray(leaf, self.dtype) for leaf in self._leaves("sample_inputs", fed)], axis=1)
            shape = blocks, samples, columns.shape[1], self.lanes
            feed = np.ascontiguousarray(np.broadcast_to(columns[None, :, :, None], shape))

        def work(some: range) -> None:
            tables = (table[some.start :] if table.size else None for table in (state, fixed, feed, kept))
            self.run(*tables, scalars, first, per_sample, samples, len(some))

        each(work, [range(blocks)] if threads == 1 else [range(b, b + 1) for b in range(blocks)], threads)
        seen = kept.transpose(2, 1, 0, 3).reshape(rows, samples, -1)[..., :count] if keep else ()
        return Marched(self.tree(state, count), self._tree(seen) if keep else None)

    def run(self, state, fixed, fed, kept, scalars, first: int, per_sample: int, samples: int, blocks: int = 1) -> None:
        """`march` on tables as they lie in memory, the state being replaced; see `assembly` for their shapes.

        `state` and `fixed` as `blocks` makes them, `scalars` likewise; `fed` and `kept`, with the shape
        (blocks, samples, rows, lanes), may be None.
        """
        tables = (None if table is None else table.ctypes.data for table in (state, fixed, scalars, fed, kept))
        self._code(*tables, first, per_sample, samples, blocks)

    def scalars(self, uniform: Any) -> np.ndarray:
        """What is the same for all lanes, as `run` takes it."""
        return np.array([*self._leaves("uniform", uniform)], self.dtype)

    def tree(self, table: np.ndarray, count: int) -> Any:
        """The carry of `count` lanes from a table (blocks, rows, lanes)."""
        return self._tree(table.transpose(1, 0, 2).reshape(table.shape[1], -1)[:, :count])

    def _tree(self, rows) -> Any:
        return jax.tree.unflatten(self._structures["carry"], list(rows))

    def _leaves(self, which: str, tree: Any) -> list:
        leaves, structure = jax.tree.flatten(tree)
        if structure != self._structures[which]:
            raise ValueError(f"this loop was compiled for {self._structures[which]}, not for {structure}")
        return leaves

    def blocks(self, which: str, tree: Any, count: int) -> np.ndarray:
        """The rows of a table ("carry" or "lane"), cut into blocks of lanes: (blocks, rows, lanes).

        The last block is filled up with its last lane.
        """
        rows = self._leaves(which, tree)
        table = np.empty((len(rows), -(-count // self.lanes) * self.lanes), self.dtype)
        for row, leaf in zip(table, rows, strict=True):
            row[:count] = leaf
        table[:, count:] = table[:, count - 1 : count]
        return np.ascontiguousarray(table.reshape(len(rows), -1, self.lanes).transpose(1, 0, 2))
