"""Loops in machine code of this processor: many lanes side by side in vector registers."""

import ctypes
import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np
from numpy.lib.stride_tricks import as_strided

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
        """See `Loop.at_samples`; what is given is written straight to where the machine code reads it."""
        samples, count = shape
        given, fixed = (_joined(self.body.leaves(n, tree)) for n, tree in (("carry", carry), ("lane", lane)))
        chunk, scalars = min(samples, SAMPLES_PER_CHUNK), self.scalars(uniform)
        blocks = -(-chunk * count // self.lanes)
        states = np.empty((blocks, sum(map(len, given)), self.lanes), self.dtype)
        lanes = np.empty((blocks, sum(map(len, fixed)), self.lanes), self.dtype)
        out = np.empty((states.shape[1], samples, count), self.dtype)
        for first in range(0, samples, chunk):
            here = slice(first, min(first + chunk, samples))
            size = here.stop - first
            _write(states, given, here, count)
            # what is the same at all samples is written once: the first chunk is the longest
            _write(lanes, fixed, here, count, only_varied=first > 0)
            self.run_tables(states, lanes, None, None, scalars, 0, 1, 1, -(-size * count // self.lanes))
            flat = states.transpose(1, 0, 2).reshape(len(out), -1)[:, : size * count]
            out[:, here] = flat.reshape(len(out), size, count)
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
        rows = _joined(self.body.leaves(which, tree))
        table = np.empty((-(-count // self.lanes), sum(map(len, rows)), self.lanes), self.dtype)
        _write(table, rows, slice(0, 1), count)
        return table

    def tree(self, table: np.ndarray, count: int) -> Any:
        """The carry of `count` lanes from a table (blocks, rows, lanes)."""
        return self._unflatten(table.transpose(1, 0, 2).reshape(table.shape[1], -1)[:, :count])

    def _unflatten(self, rows) -> Any:
        return jax.tree.unflatten(jax.tree.structure(self.body.carry), list(rows))


def _joined(leaves: Sequence[Any]) -> list[np.ndarray]:
    """Numbers and arrays (lanes,) or (samples, lanes) as few arrays (leaves, samples or 1, lanes or 1).

    Neighbours that are views of one array, at equal distances in its memory, become one array without a copy.
    """
    found: list[np.ndarray] = []
    arrays = [np.asarray(leaf) for leaf in leaves]
    layouts = [(a.shape, a.strides, a.dtype, id(a if a.base is None else a.base)) for a in arrays]
    addresses = [a.__array_interface__["data"][0] for a in arrays]
    first = 0
    while first < len(arrays):
        shape, strides = arrays[first].shape, arrays[first].strides
        last = first + 1
        if not shape:
            while last < len(arrays) and not arrays[last].shape:
                last += 1
            joined = np.array(arrays[first:last])
        else:
            distance = 0
            while last < len(arrays) and layouts[last] == layouts[first]:
                step = addresses[last] - addresses[last - 1]
                if last > first + 1 and step != distance:
                    break
                distance, last = step, last + 1
            joined = as_strided(arrays[first], (last - first, *shape), (distance, *strides), writeable=False)
        found.append(joined.reshape(len(joined), *(1,) * (2 - len(shape)), *shape))
        first = last
    return found


def _write(table: np.ndarray, rows: Sequence[np.ndarray], here: slice, count: int, only_varied: bool = False) -> None:
    """Write some samples of rows to a table (blocks, rows, lanes), sample after sample; the last number fills it up.

    Args:
        table: where to write; it may have more blocks than these samples need.
        rows: arrays (rows, samples or 1, lanes or 1), as `_joined` makes them.
        here: the samples.
        count: number of lanes of each sample.
        only_varied: whether to leave out what is the same at all samples.
    """
    size, lanes, first = here.stop - here.start, table.shape[-1], 0
    whole, left = divmod(size * count, lanes)
    for some in rows:
        target, first = table[:, first : first + len(some)], first + len(some)
        is_constant = some.shape[1] == 1
        if only_varied and is_constant:
            continue
        some = np.broadcast_to(some if is_constant else some[:, here], (len(some), size, count))
        if count % lanes == 0:  # no block has lanes of two samples, so that a view is enough
            parts = some.reshape(len(some), size, -1, lanes).transpose(1, 2, 0, 3)
            target[:whole].reshape(parts.shape)[:] = parts
            continue
        flat = some.reshape(len(some), -1)
        target[:whole] = flat[:, : whole * lanes].reshape(len(some), whole, lanes).transpose(1, 0, 2)
        if left:
            target[whole, :, :left], target[whole, :, left:] = flat[:, whole * lanes :], flat[:, -1:]
