"""The interface of the engines: run the body of a time loop over many lanes for many steps, and back for derivatives.

A lane is one instance of the loop, for example one design of a batch. An engine compiles a `LoopBody` into a `Loop` (or
an `AdjointLoop`); what is batched, sampled or differentiated is decided by the caller, not by the engine. Forward-mode
derivatives need no support of their own: they are another body.
"""

import abc
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np


class Untranslatable(Exception):
    """An engine cannot run this body; the text says which operation or input it has no counterpart for."""


@dataclasses.dataclass(frozen=True)
class LoopBody:
    """carry ← step(n, carry, lane, uniform) for n = first, first + 1, …, for each lane on its own.

    Attributes:
        step: a JAX function of scalars; with `sample_inputs` it takes them as a fifth argument.
        dtype: floating-point type of every number.
        carry: what a step turns into the next one. This and the following three are pytrees of real scalars that count
            only by their structure.
        lane: what differs from lane to lane and stays the same over the steps.
        uniform: what is the same for all lanes. Only here leaves may be arrays.
        sample_inputs: what changes from sample to sample (see `Loop.run`), or None.
        tangents: of the structure of `carry`, true where a leaf is a derivative; such values are computed in the order
            of the body, which keeps the tangents of one variable together.
        key: a text that stands for everything the body depends on, its source included; with it machine code is found
            in the cache without tracing the body. None: the traced body is the key.
        vectors: how many vectors of lanes the native engine interleaves; None: its default.
        single_lane: the loop is run for one lane at a time.
        many_lanes: the loop is run for so many lanes that a GPU is faster than the processor (`engines.many_lanes`).
    """

    step: Callable
    dtype: Any
    carry: Any
    lane: Any
    uniform: Any
    sample_inputs: Any = None
    tangents: Any = None
    key: str | None = None
    vectors: int | None = None
    single_lane: bool = False
    many_lanes: bool = False

    @property
    def inputs(self) -> dict[str, Any]:
        """What a step takes beside its number, by field name, in the order of its arguments."""
        names = ("carry", "lane", "uniform") + (() if self.sample_inputs is None else ("sample_inputs",))
        return {name: getattr(self, name) for name in names}

    def leaves(self, which: str, tree: Any) -> list:
        """The leaves of `tree`, which must have the structure of the field `which`.

        Raises:
            ValueError: it has another structure.
        """
        leaves, structure = jax.tree.flatten(tree)
        expected = jax.tree.structure(getattr(self, which))
        if structure != expected:
            raise ValueError(f"this loop was compiled for {which} = {expected}, not for {structure}")
        return leaves


class LoopResult(NamedTuple):
    """The final carry, leaves (lanes,), and those at the start of each sample, leaves (samples, lanes)."""

    carry: Any
    samples: Any


class Loop(abc.ABC):
    """A compiled loop. The numbers of a lane depend on that lane alone, not on its neighbours or the threads.

    Attributes:
        lanes: number of lanes that are computed together: fewer cost as much.
        engine: name of the engine that compiled the loop; empty if it was not compiled through `engines`.
    """

    lanes: int
    engine: str = ""

    @abc.abstractmethod
    def run(
        self, carry: Any, lane: Any, uniform: Any, first: int, steps_per_sample: int, samples: int, threads: int = 1,
        keep: bool = True, sample_inputs: Any = None,
    ) -> LoopResult:  # fmt: skip
        """Take `samples` times `steps_per_sample` steps; there has to be at least one of each, and one lane.

        Args:
            carry: where the lanes start; leaves (lanes,), all but the first may also be one number for all lanes.
            lane: leaves (lanes,).
            uniform: leaves are numbers, or arrays where the body has them.
            first: the number of the first step.
            steps_per_sample: steps between two samples.
            samples: number of samples; the first is the initial carry.
            threads: threads of this process that share the lanes.
            keep: whether the carry at the start of each sample is returned.
            sample_inputs: leaves (samples,), the same for all lanes.

        Raises:
            ValueError: an argument has another structure than the body was compiled for, or there is no lane, step or
                sample.
        """

    def with_vectors(self, vectors: int) -> "Loop":
        """The same loop with blocks of so many vectors; an engine whose blocks are fixed returns the loop itself."""
        return self

    def __call__(self, carry: Any, lane: Any, uniform: Any, first: int, steps: int, threads: int = 1) -> Any:
        """The carry after `steps` steps; arguments as of `run`."""
        return self.run(carry, lane, uniform, first, steps, 1, threads, keep=False).carry

    def at_samples(self, carry: Any, lane: Any, uniform: Any, shape: tuple[int, int]) -> Any:
        """The carry after one step, n = 0, at every sample of every lane.

        Args:
            carry: leaves that can be broadcast to `shape`.
            lane: the same.
            uniform: as of `run`.
            shape: (samples, lanes).

        Returns:
            The carry, leaves (samples, lanes).
        """
        carry, lane = (jax.tree.map(lambda leaf: np.broadcast_to(leaf, shape).ravel(), tree) for tree in (carry, lane))
        return jax.tree.map(lambda leaf: np.reshape(leaf, shape), self(carry, lane, uniform, 0, 1))


class AdjointLoop(abc.ABC):
    """A compiled loop and its reverse-mode derivative.

    Only the carries at some steps are kept as checkpoints; the steps between are computed again on the way back
    (Griewank & Walther, Evaluating Derivatives, 2008, chapter 12).

    Attributes:
        engine: as of `Loop`.
    """

    engine: str = ""

    @abc.abstractmethod
    def run(self, carry: Any, lane: Any, uniform: Any, steps: int, threads: int = 1) -> tuple[Any, Any]:
        """The carry after `steps` steps from n = 0, leaves (lanes,), and the checkpoints that `vjp` needs."""

    @abc.abstractmethod
    def vjp(
        self, checkpoints: Any, cotangents: Sequence[Any], lane: Any, uniform: Any, threads: int = 1
    ) -> list[tuple[Any, Any]]:
        """For each cotangent of the final carry: those of the initial carry and of `lane`; leaves (lanes,).

        The checkpoints may come from another loop of the same engine whose carry begins with the leaves of this one.
        """


class LoopEngine(abc.ABC):
    """What compiles loops and runs them.

    Attributes:
        name: by which it is asked for.
        for_many_lanes: whether it is asked only for loops with many lanes, and not missed where it cannot serve.
    """

    name: str
    for_many_lanes: bool = False

    @abc.abstractmethod
    def unavailable(self) -> str:
        """Why this engine cannot serve in this process; empty if it can."""

    @abc.abstractmethod
    def outside_scope(self, body: LoopBody) -> str:
        """Why bodies of this kind are never given to this engine, by design; empty if they are."""

    @abc.abstractmethod
    def compile(self, body: LoopBody) -> Loop:
        """Compile a loop.

        Raises:
            Untranslatable: the body uses an operation that this engine has no counterpart for.
        """

    @abc.abstractmethod
    def compile_adjoint(self, body: LoopBody) -> AdjointLoop:
        """Compile a loop with its reverse-mode derivative.

        Raises:
            Untranslatable: the body or its derivative uses an operation that this engine has no counterpart for.
        """

    def device_names(self) -> str:
        """The devices on which the loops run; empty where it is the one on which JAX computes."""
        return ""

    def probably_slower(self, loop: Loop | AdjointLoop) -> str:
        """Why the next engine is likely to be faster for this compiled loop; empty if nothing says so."""
        return ""


def lane_count(carry: Any) -> int:
    """The number of lanes of a carry."""
    return int(np.shape(jax.tree.leaves(carry)[0])[0])


def check_size(lanes: int, steps_per_sample: int, samples: int) -> None:
    """Refuse a run without lanes, steps or samples, which machine code would not notice.

    Raises:
        ValueError: one of the numbers is less than one.
    """
    if min(lanes, steps_per_sample, samples) < 1:
        what = f"{lanes} lanes, {steps_per_sample} steps per sample and {samples} samples"
        raise ValueError(f"a loop needs at least one lane, one step and one sample, not {what}")
