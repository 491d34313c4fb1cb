"""Reverse mode in machine code: the steps of a loop are run again in segments and gone through backwards."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from edhas_jax.compiler.backward_body import backward_body
from edhas_jax.compiler.loop_engine import AdjointLoop, LoopBody, lane_count
from edhas_jax.compiler.native_loop import NativeLoop
from edhas_jax.compiler.threads import run_threaded

SEGMENT_STEPS = 256  # steps that are run again at a time: their carries stay in the processor's cache


class NativeCheckpoints(NamedTuple):
    """The carry before every segment of steps, (blocks, segments, rows, lanes), and the number of steps."""

    carries: np.ndarray
    steps: int


class NativeAdjointLoop(AdjointLoop):
    """`AdjointLoop` in machine code.

    Raises:
        Untranslatable: the body, or its derivative, uses an operation that has no counterpart in the scalar IR.
    """

    def __init__(self, body: LoopBody):
        self._ahead = NativeLoop(body)
        # a step back holds all values of the step ahead: those of a second vector would not fit the nearest cache
        self._back = NativeLoop(dataclasses.replace(backward_body(body), vectors=1), backwards=True)

    def run(self, carry: Any, lane: Any, uniform: Any, steps: int, threads: int = 1) -> tuple[Any, NativeCheckpoints]:
        """See `AdjointLoop.run`."""
        count = lane_count(carry)
        state, fixed = self._ahead.blocks("carry", carry, count), self._ahead.blocks("lane", lane, count)
        scalars = self._ahead.scalars(uniform)
        blocks, rows, lanes = state.shape
        whole, rest = divmod(steps, SEGMENT_STEPS)
        carries = np.empty((blocks, whole + bool(rest), rows, lanes), state.dtype)

        def work(b: int) -> None:
            if whole:
                self._ahead.run_tables(state[b], fixed[b], None, carries[b], scalars, 0, SEGMENT_STEPS, whole)
            if rest:
                carries[b, whole] = state[b]
                self._ahead.run_tables(state[b], fixed[b], None, None, scalars, whole * SEGMENT_STEPS, rest, 1)

        run_threaded(work, range(blocks), threads)
        return self._ahead.tree(state, count), NativeCheckpoints(carries, steps)

    def vjp(
        self, checkpoints: NativeCheckpoints, cotangents: Sequence[Any], lane: Any, uniform: Any, threads: int = 1
    ) -> list[tuple[Any, Any]]:
        """See `AdjointLoop.vjp`."""
        count = lane_count(cotangents[0])
        nothing = jax.tree.map(lambda leaf: np.zeros(count), lane)
        tables = [self._back.blocks("carry", (w, nothing), count) for w in cotangents]
        fixed, narrow = (loop.blocks("lane", lane, count) for loop in (self._ahead, self._back))
        scalars, lanes = self._ahead.scalars(uniform), self._back.lanes
        rows = jax.tree.structure(self._ahead.body.carry).num_leaves
        # a block of the run ahead is as wide as several of the way back
        parts = self._ahead.lanes // lanes

        def work(b: int) -> None:
            carries = checkpoints.carries[b][:, :rows]
            wide = np.empty((SEGMENT_STEPS, rows, parts * lanes), carries.dtype)
            before = np.empty((parts, SEGMENT_STEPS, rows, lanes), carries.dtype)
            for k in reversed(range(len(carries))):
                first, state = k * SEGMENT_STEPS, carries[k].copy()
                steps = min(SEGMENT_STEPS, checkpoints.steps - first)
                self._ahead.run_tables(state, fixed[b], None, wide, scalars, first, 1, steps)
                for part, block in enumerate(range(b * parts, min((b + 1) * parts, len(narrow)))):
                    np.copyto(before[part, :steps], wide[:steps, :, part * lanes : (part + 1) * lanes])
                    for table in tables:
                        self._back.run_tables(table[block], narrow[block], before[part], None, scalars, first, 1, steps)

        run_threaded(work, range(len(fixed)), threads)
        return [self._back.tree(table, count) for table in tables]
