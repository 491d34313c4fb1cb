"""A loop that can be gone back through: derivatives of its end by its beginning and by what its lanes hold."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.native_loop import Loop
from edhas_jax.compiler.threads import each

STRETCH = 256  # steps that are run again at a time on the way back: their carries stay in the processor's cache


class Trail(NamedTuple):
    """Where a run came along: the carry before every stretch, (blocks, stretches, rows, lanes), and its length."""

    carries: np.ndarray
    steps: int

    def rows(self, count: int) -> "Trail":
        """The trail of the first `count` leaves of the carry, for a loop that needs no others."""
        return self._replace(carries=self.carries[:, :, :count])


class AdjointLoop:
    """carry ← body(n, carry, lane, uniform) for n = 0, 1, …, as `Loop`, and the way back.

    With w a covector of the carry, the way back takes each step as  (w, v) ← (wᵀ ∂body/∂carry, v + wᵀ ∂body/∂lane).
    Kept are the carries before every stretch of steps; on the way back a stretch is run again and keeps all of its own.

    Raises:
        Untranslatable: the body, or its derivative, uses an operation that is not known here.
    """

    def __init__(self, body: Callable, dtype, carry: Any, lane: Any, uniform: Any, cache: Path | None = None):
        def back(n, pulled, lane, uniform, before):
            by_carry, by_lane = pulled
            _, pull = jax.vjp(lambda carry, lane: body(n, carry, lane, uniform), before, lane)
            by_carry, share = pull(by_carry)
            return by_carry, jax.tree.map(jnp.add, by_lane, share)

        self._ahead = Loop(body, dtype, carry, lane, uniform, cache)
        # a step back holds all values of the step ahead: those of a second vector would not fit the nearest cache
        self._back = Loop(back, dtype, (carry, lane), lane, uniform, cache, fed=carry, backwards=True, vectors=1)

    def run(self, carry: Any, lane: Any, uniform: Any, steps: int, threads: int = 1) -> tuple[Any, Trail]:
        """The carry after `steps` steps, and what is needed to go back; leaves have the shape (lanes,)."""
        count = np.shape(jax.tree.leaves(carry)[0])[0]
        state, fixed = self._ahead.blocks("carry", carry, count), self._ahead.blocks("lane", lane, count)
        scalars = self._ahead.scalars(uniform)
        blocks, rows, lanes = state.shape
        whole, rest = divmod(steps, STRETCH)
        carries = np.empty((blocks, whole + bool(rest), rows, lanes), state.dtype)

        def work(b: int) -> None:
            if whole:
                self._ahead.run(state[b], fixed[b], None, carries[b], scalars, 0, STRETCH, whole)
            if rest:
                carries[b, whole] = state[b]
                self._ahead.run(state[b], fixed[b], None, None, scalars, whole * STRETCH, rest, 1)

        each(work, range(blocks), threads)
        return self._ahead.tree(state, count), Trail(carries, steps)

    def pull(
        self, trail: Trail, covectors: Sequence[Any], lane: Any, uniform: Any, threads: int = 1
    ) -> list[tuple[Any, Any]]:
        """For each covector of the carry at the end: those of the carry at the start, and of `lane`."""
        count = np.shape(jax.tree.leaves(covectors[0])[0])[0]
        nothing = jax.tree.map(lambda leaf: np.zeros(count), lane)
        pulled = [self._back.blocks("carry", (w, nothing), count) for w in covectors]
        fixed, narrow = (loop.blocks("lane", lane, count) for loop in (self._ahead, self._back))
        scalars, lanes = self._ahead.scalars(uniform), self._back.lanes
        # a block of the run ahead is as wide as several of the way back
        parts = self._ahead.lanes // lanes

        def work(b: int) -> None:
            carries, rows = trail.carries[b], trail.carries.shape[2]
            wide = np.empty((STRETCH, rows, parts * lanes), carries.dtype)
            seen = np.empty((parts, STRETCH, rows, lanes), carries.dtype)
            for k in reversed(range(len(carries))):
                first, state = k * STRETCH, carries[k].copy()
                steps = min(STRETCH, trail.steps - first)
                self._ahead.run(state, fixed[b], None, wide, scalars, first, 1, steps)
                for part, block in enumerate(range(b * parts, min((b + 1) * parts, len(narrow)))):
                    np.copyto(seen[part, :steps], wide[:steps, :, part * lanes : (part + 1) * lanes])
                    for table in pulled:
                        self._back.run(table[block], narrow[block], seen[part], None, scalars, first, 1, steps)

        each(work, range(len(fixed)), threads)
        return [self._back.tree(table, count) for table in pulled]
