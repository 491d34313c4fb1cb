"""The XLA engine: loops as programs of JAX, for accelerators and for bodies that have no machine code.

Every block of lanes is one call of one compiled program, so that neither the number of lanes nor that of samples or
steps compiles anything anew; on a CPU the blocks are shared among threads.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core

from edhas_jax.compiler.loop_engine import (
    AdjointLoop,
    Loop,
    LoopBody,
    LoopEngine,
    LoopResult,
    check_size,
    lane_count,
)
from edhas_jax.compiler.threads import run_threaded
from edhas_jax.core import runtime

BLOCK_BYTES = 512  # of one variable on a CPU: enough for the vector units, little enough for the first-level cache
ACCELERATOR_LANES = 4096  # of a block on an accelerator, where a step costs the same up to many more lanes
SAMPLES_PER_CALL = 256  # samples that one call of the program can hold; a longer run calls it again
CHECKPOINT_STEPS = 64  # steps that are run again at a time on the way back


class XlaEngine(LoopEngine):
    """Loops as XLA programs: takes every body, on every device that JAX has."""

    name = "xla"

    def unavailable(self) -> str:
        """See `LoopEngine.unavailable`."""
        return ""

    def outside_scope(self, body: LoopBody) -> str:
        """See `LoopEngine.outside_scope`."""
        return ""

    def compile(self, body: LoopBody) -> Loop:
        """See `LoopEngine.compile`."""
        return XlaLoop(body)

    def compile_adjoint(self, body: LoopBody) -> AdjointLoop:
        """See `LoopEngine.compile_adjoint`."""
        return XlaAdjointLoop(body)


# On a CPU the fusion pass of XLA copies every shared value into each of its users. A plain step survives that with the
# older code generator; a step with derivatives takes minutes to compile, and is compiled without fusion instead.
PLAIN_OPTIONS = {"xla_cpu_use_fusion_emitters": False}
DERIVATIVE_OPTIONS = {"xla_disable_hlo_passes": "fusion"}
LARGEST_PLAIN_STEP = 3000  # operations of a step; one with a tangent has several times as many as one without


def _jit(f, options: dict):
    known = _are_known(tuple(options.items()), runtime.platform())
    return jax.jit(f, compiler_options=options if known else None)


@functools.cache
def _are_known(options: tuple, platform: str) -> bool:
    """Whether XLA takes these compiler options on a platform, which is the present one."""
    if platform != "cpu":
        return False
    try:
        jax.jit(lambda x: x + 1.0, compiler_options=dict(options))(np.float32(0.0))
    except (RuntimeError, ValueError):
        return False
    return True


def _operations(body: LoopBody) -> int:
    """The number of operations of one step."""

    def counted(jaxpr) -> int:
        inner = (counted(inner) for eqn in jaxpr.eqns for inner in core.jaxprs_in_params(eqn.params))
        return len(jaxpr.eqns) + sum(inner)

    dtype = np.dtype(body.dtype)
    given = [jax.tree.map(lambda leaf: np.zeros(np.shape(leaf), dtype), tree) for tree in body.inputs.values()]
    with runtime.double_precision():
        return counted(jax.make_jaxpr(body.step)(np.zeros((), dtype), *given).jaxpr)


def block_lanes(body: LoopBody) -> int:
    """The lanes of a block."""
    if body.single_lane:
        return 1
    if runtime.platform() != "cpu":
        return ACCELERATOR_LANES
    return BLOCK_BYTES // np.dtype(body.dtype).itemsize


class _Blocks:
    """Pytrees of lanes cut into blocks of equal length; the last lane fills the last block up."""

    def __init__(self, body: LoopBody, count: int):
        self._body, self._count, self._lanes = body, count, block_lanes(body)
        self.number = -(-count // self._lanes)

    def of(self, which: str, tree: Any, b: int) -> Any:
        """Block `b` of a pytree with the structure of the body's `which`."""
        rows = np.minimum(np.arange(b * self._lanes, (b + 1) * self._lanes), self._count - 1)
        dtype = np.dtype(self._body.dtype)
        leaves = [
            np.broadcast_to(np.asarray(leaf, dtype), self._count)[rows] for leaf in self._body.leaves(which, tree)
        ]
        return jax.tree.unflatten(jax.tree.structure(getattr(self._body, which)), leaves)

    def place(self, out: np.ndarray, b: int, block: Any) -> None:
        """Write the last axis of a block into an array that has all lanes there."""
        first = b * self._lanes
        last = min(first + self._lanes, self._count)
        out[..., first:last] = np.asarray(block)[..., : last - first]


def _numbers(body: LoopBody, which: str, tree: Any) -> Any:
    """The leaves as arrays of the body's type."""
    dtype = np.dtype(body.dtype)
    leaves = [np.asarray(leaf, dtype) for leaf in body.leaves(which, tree)]
    return jax.tree.unflatten(jax.tree.structure(getattr(body, which)), leaves)


def _allocated(tree: Any, shape: tuple[int, ...], dtype) -> Any:
    """A pytree like `tree` of arrays to be filled."""
    return jax.tree.map(lambda _: np.empty(shape, dtype), tree)


class XlaLoop(Loop):
    """A `LoopBody` as an XLA program."""

    def __init__(self, body: LoopBody):
        self.body, self.lanes = body, block_lanes(body)
        self._dtype = np.dtype(body.dtype)
        options = PLAIN_OPTIONS if _operations(body) <= LARGEST_PLAIN_STEP else DERIVATIVE_OPTIONS
        self._advance, self._sample = _jit(self._steps, options), _jit(self._samples, options)

    def run(
        self, carry: Any, lane: Any, uniform: Any, first: int, steps_per_sample: int, samples: int, threads: int = 1,
        keep: bool = True, sample_inputs: Any = None,
    ) -> LoopResult:  # fmt: skip
        """See `Loop.run`."""
        body, count = self.body, lane_count(carry)
        check_size(count, steps_per_sample, samples)
        blocks, uniform = _Blocks(body, count), _numbers(body, "uniform", uniform)
        inputs = None if sample_inputs is None else _numbers(body, "sample_inputs", sample_inputs)
        final = _allocated(body.carry, (count,), self._dtype)
        kept = _allocated(body.carry, (samples, count), self._dtype) if keep else None

        def work(b: int) -> None:
            here, fixed = blocks.of("carry", carry, b), blocks.of("lane", lane, b)
            with runtime.double_precision():
                if not keep and inputs is None:
                    here = self._advance(here, fixed, uniform, first, samples * steps_per_sample)
                else:
                    for start in range(0, samples, SAMPLES_PER_CALL):
                        wanted = min(SAMPLES_PER_CALL, samples - start)
                        some = jax.tree.map(lambda leaf, s=start: _padded(leaf[s : s + SAMPLES_PER_CALL]), inputs)
                        number = first + start * steps_per_sample
                        here, rows = self._sample(here, fixed, uniform, number, steps_per_sample, wanted, some)
                        if keep:
                            for out, row in zip(jax.tree.leaves(kept), jax.tree.leaves(rows), strict=True):
                                blocks.place(out[start : start + wanted], b, np.asarray(row)[:wanted])
                for out, leaf in zip(jax.tree.leaves(final), jax.tree.leaves(here), strict=True):
                    blocks.place(out, b, leaf)

        run_threaded(work, range(blocks.number), threads)
        return LoopResult(final, kept)

    def _steps(self, carry, lane, uniform, first, steps):
        """`steps` steps of one block."""
        return self._go(carry, lane, uniform, first, steps, ())

    def _go(self, carry, lane, uniform, first, steps, inputs):
        def one(carry, lane):
            return jax.lax.fori_loop(
                0, steps, lambda k, c: self.body.step((first + k).astype(self._dtype), c, lane, uniform, *inputs), carry
            )

        return jax.vmap(one)(carry, lane)

    def _samples(self, carry, lane, uniform, first, per_sample, samples, inputs):
        """The carry after `samples` samples of one block, and those at their starts, (SAMPLES_PER_CALL, lanes)."""
        rows = jax.tree.map(lambda leaf: jnp.zeros((SAMPLES_PER_CALL, *leaf.shape), leaf.dtype), carry)

        def sample(k, state):
            carry, rows = state
            rows = jax.tree.map(lambda table, leaf: table.at[k].set(leaf), rows, carry)
            given = () if inputs is None else (jax.tree.map(lambda leaf: leaf[k], inputs),)
            return self._go(carry, lane, uniform, first + k * per_sample, per_sample, given), rows

        return jax.lax.fori_loop(0, samples, sample, (carry, rows))


def _padded(leaf: np.ndarray) -> np.ndarray:
    return np.concatenate([leaf, np.zeros(SAMPLES_PER_CALL - len(leaf), leaf.dtype)])


class XlaCheckpoints(NamedTuple):
    """The carry before every segment of steps, leaves (segments, lanes), and the number of steps."""

    carries: Any
    steps: int


class XlaAdjointLoop(AdjointLoop):
    """`AdjointLoop` as XLA programs."""

    def __init__(self, body: LoopBody):
        self.body = body
        self._ahead = XlaLoop(body)
        self._back = _jit(self._segment, DERIVATIVE_OPTIONS)

    def run(self, carry: Any, lane: Any, uniform: Any, steps: int, threads: int = 1) -> tuple[Any, XlaCheckpoints]:
        """See `AdjointLoop.run`."""
        whole, rest = divmod(steps, CHECKPOINT_STEPS)
        carry, kept = self._ahead.run(carry, lane, uniform, 0, CHECKPOINT_STEPS, whole, threads)
        if rest:
            kept = jax.tree.map(lambda table, leaf: np.concatenate([table, leaf[None]]), kept, carry)
            carry = self._ahead(carry, lane, uniform, whole * CHECKPOINT_STEPS, rest, threads)
        return carry, XlaCheckpoints(kept, steps)

    def vjp(
        self, checkpoints: XlaCheckpoints, cotangents: Sequence[Any], lane: Any, uniform: Any, threads: int = 1
    ) -> list[tuple[Any, Any]]:
        """See `AdjointLoop.vjp`."""
        body, count = self.body, lane_count(cotangents[0])
        blocks, uniform, dtype = _Blocks(body, count), _numbers(body, "uniform", uniform), np.dtype(body.dtype)
        out = [_allocated((body.carry, body.lane), (count,), dtype) for _ in cotangents]

        def work(b: int) -> None:
            fixed = blocks.of("lane", lane, b)
            by = [(blocks.of("carry", w, b), jax.tree.map(np.zeros_like, fixed)) for w in cotangents]
            by = jax.tree.map(lambda *leaves: np.stack(leaves), *by)
            segments = -(-checkpoints.steps // CHECKPOINT_STEPS)
            structure = jax.tree.structure(body.carry)
            tables = jax.tree.leaves(checkpoints.carries)[: structure.num_leaves]
            with runtime.double_precision():
                for k in reversed(range(segments)):
                    first = k * CHECKPOINT_STEPS
                    start = blocks.of("carry", jax.tree.unflatten(structure, [table[k] for table in tables]), b)
                    steps = min(CHECKPOINT_STEPS, checkpoints.steps - first)
                    by = self._back(start, by, fixed, uniform, first, steps)
            for i, tree in enumerate(out):
                for whole, leaf in zip(jax.tree.leaves(tree), jax.tree.leaves(by), strict=True):
                    blocks.place(whole, b, leaf[i])

        run_threaded(work, range(blocks.number), threads)
        return out

    def _segment(self, start, by, lane, uniform, first, steps):
        """`steps` steps of one block run again, and back: cotangents (cotangents, lanes) of carry and lane."""
        dtype = np.dtype(self.body.dtype)

        def step(k, carry, lane):
            return self.body.step((first + k).astype(dtype), carry, lane, uniform)

        def one(start, by, lane):
            rows = jax.tree.map(lambda leaf: jnp.zeros((CHECKPOINT_STEPS, *leaf.shape), leaf.dtype), start)

            def ahead(k, state):
                carry, rows = state
                rows = jax.tree.map(lambda table, leaf: table.at[k].set(leaf), rows, carry)
                return step(k, carry, lane), rows

            _, rows = jax.lax.fori_loop(0, steps, ahead, (start, rows))

            def back(j, by):
                k = steps - 1 - j
                before = jax.tree.map(lambda table: table[k], rows)
                _, pull = jax.vjp(functools.partial(step, k), before, lane)

                def pulled(by):
                    by_carry, by_lane = by
                    by_carry, share = pull(by_carry)
                    return by_carry, jax.tree.map(jnp.add, by_lane, share)

                return jax.vmap(pulled)(by)

            return jax.lax.fori_loop(0, steps, back, by)

        return jax.vmap(one, in_axes=(0, 1, 0), out_axes=1)(start, by, lane)
