"""Loops in machine code of this processor: many lanes side by side in vector registers."""

import ctypes
import dataclasses
from typing import Any

import jax
import numpy as np

from edhas_jax.compiler.body_program import body_program
from edhas_jax.compiler.llvm_jit import function, host
from edhas_jax.compiler.llvm_loop import loop_assembly
from edhas_jax.compiler.loop_engine import Loop, LoopBody, LoopResult, Untranslatable, check_size, lane_count
from edhas_jax.compiler.threads import run_threaded
from edhas_jax.core import runtime

SAMPLES_PER_CHUNK = 64  # samples that are evaluated at once: their tables stay in the second-level cache

class NativeLoop(Loop):
    """A `LoopBody` compiled by LLVM; its machine code is kept in the cache folder.

    With `backwards` the samples are gone through from the last to the first. The numbers of a lane are the same to the
    bit wherever it stands and however many threads there are.

    Raises:
        Untranslatable: the body uses an operation that has no counterpart in the scalar IR.
    """

    def __init__(self, body: LoopBody, backwards: bool = False):
        self.body, self.dtype, self._backwards = body, np.dtype(body.dtype), backwards
        processor = host().processor
        vectors = 1 if body.single_lane else body.vectors
        if vectors is not None:
            processor = dataclasses.replace(processor, vectors=vectors)

        def text() -> str:
            program, sources, rows = body_program(body)
            counts = rows["carry"], rows["lane"], rows.get("sample_inputs", 0)
            return loop_assembly(program, processor, sources, *counts, backwards)

        self.lanes = processor.lanes(self.dtype)
        arguments = [ctypes.c_void_p] * 5 + [ctypes.c_int64] * 4
        key = None if body.key is None else f"{body.key} {processor} {self.dtype} {backwards}"
        try:
            self._code = function(text, "run", arguments, runtime.cache_folder(), key)
        except RuntimeError as error:  # what LLVM says of code that it cannot compile
            raise Untranslatable(f"LLVM: {str(error).splitlines()[0] if str(error) else error!r}") from error

    def run(
        self, carry: Any, lane: Any, uniform: Any, first: int, steps_per_sample: int, samples: int, threads: int = 1,
        keep: bool = True, sample_inputs: Any = None,
    ) -> LoopResult:  # fmt: skip
        """See `Loop.run`."""
        count = lane_count(carry)
        check_size(count, steps_per_sample, samples)
        state, fixed = self.blocks("carry", carry, count), self.blocks("lane", lane, count)
        scalars = self.scalars(uniform)
        blocks, rows, _ = state.shape
        kept = np.empty((blocks, samples, rows, self.lanes) if keep else 0, self.dtype)
        inputs = np.empty(0, self.dtype)
        if sample_inputs is not None:
            leaves = self.body.leaves("sample_inputs", sample_inputs)
            columns = np.stack([np.asarray(leaf, self.dtype) for leaf in leaves], axis=1)
            shape = blocks, samples, columns.shape[1], self.lanes
            inputs = np.ascontiguousarray(np.broadcast_to(columns[None, :, :, None], shape))

        def work(some: range) -> None:
            tables = (table[some.start :] if table.size else None for table in (state, fixed, inputs, kept))
            self.run_tables(*tables, scalars, first, steps_per_sample, samples, len(some))

        parts = [range(blocks)] if threads == 1 else [range(b, b + 1) for b in range(blocks)]
        run_threaded(work, parts, threads)
        seen = kept.transpose(2, 1, 0, 3).reshape(rows, samples, -1)[..., :count] if keep else ()
        return LoopResult(self.tree(state, count), self._unflatten(seen) if keep else None)

    def at_samples(self, carry: Any, lane: Any, uniform: Any, shape: tuple[int, int]) -> Any:
        """See `Loop.at_samples`; whole blocks are written straight to where the machine code reads them."""
        samples, count = shape
        if count % self.lanes:
            return super().at_samples(carry, lane, uniform, shape)
        given = [np.broadcast_to(leaf, shape) for leaf in self.body.leaves("carry", carry)]
        fixed = [np.broadcast_to(leaf, shape) for leaf in self.body.leaves("lane", lane)]
        per_lane, scalars = count // self.lanes, self.scalars(uniform)
        chunk = min(samples, SAMPLES_PER_CHUNK)
        states = np.empty((chunk, per_lane, len(given), self.lanes), self.dtype)
        lanes = np.empty((chunk, per_lane, len(fixed), self.lanes), self.dtype)
        varied = []
        for k, leaf in enumerate(fixed):
            if leaf.strides[0] == 0:  # broadcast: the same at all samples, so that it is written once
                lanes[:, :, k] = leaf[:chunk].reshape(chunk, per_lane, self.lanes)
            else:
                varied.append(k)
        out = [np.empty(shape, self.dtype) for _ in given]
        for first in range(0, samples, chunk):
            here = slice(first, min(first + chunk, samples))
            size = here.stop - first
            for k, leaf in enumerate(given):
                states[:size, :, k] = leaf[here].reshape(size, per_lane, self.lanes)
            for k in varied:
                lanes[:size, :, k] = fixed[k][here].reshape(size, per_lane, self.lanes)
            self.run_tables(states, lanes, None, None, scalars, 0, 1, 1, size * per_lane)
            for k, column in enumerate(out):
                column[here] = states[:size, :, k].reshape(size, count)
        return self._unflatten(out)

    def with_vectors(self, vectors: int) -> "NativeLoop":
        """See `Loop.with_vectors`."""
        return NativeLoop(dataclasses.replace(self.body, vectors=vectors), self._backwards)

    def run_tables(
        self, state, fixed, inputs, kept, scalars, first: int, steps_per_sample: int, samples: int, blocks: int = 1
    ) -> None:
        """`run` on tables as they lie in memory, the state being replaced; see `llvm_loop` for their shapes.

        Args:
            state: carry, as `blocks` makes it.
            fixed: lane values, as `blocks` makes them.
            inputs: sample inputs, (blocks, samples, rows, lanes), or None.
            kept: where the carries at the samples go, (blocks, samples, rows, lanes), or None.
            scalars: uniform values, as `scalars` makes them.
            first: number of the first step.
            steps_per_sample: steps between two samples.
            samples: number of samples.
            blocks: number of blocks in the tables.
        """
        tables = (None if table is None else table.ctypes.data for table in (state, fixed, scalars, inputs, kept))
        self._code(*tables, first, steps_per_sample, samples, blocks)

    def scalars(self, uniform: Any) -> np.ndarray:
        """What is the same for all lanes, as one array (leaves,)."""
        return np.array([*self.body.leaves("uniform", uniform)], self.dtype)

    def blocks(self, which: str, tree: Any, count: int) -> np.ndarray:
        """The leaves of "carry" or "lane" as a table (blocks, rows, lanes); the last lane fills the last block up."""
        rows = self.body.leaves(which, tree)
        blocks, whole = -(-count // self.lanes), count // self.lanes
        table = np.empty((blocks, len(rows), self.lanes), self.dtype)
        for k, leaf in enumerate(rows):
            leaf = np.asarray(leaf)
            if leaf.ndim == 0:
                table[:, k] = leaf
                continue
            leaf = np.broadcast_to(leaf, count)
            table[:whole, k] = leaf[: whole * self.lanes].reshape(whole, self.lanes)
            if whole < blocks:
                left = count - whole * self.lanes
                table[whole, k, :left], table[whole, k, left:] = leaf[whole * self.lanes :], leaf[-1]
        return table

    def tree(self, table: np.ndarray, count: int) -> Any:
        """The carry of `count` lanes from a table (blocks, rows, lanes)."""
        return self._unflatten(table.transpose(1, 0, 2).reshape(table.shape[1], -1)[:, :count])

    def _unflatten(self, rows) -> Any:
        return jax.tree.unflatten(jax.tree.structure(self.body.carry), list(rows))
