"""The body of the loop that goes back through the steps of another one, for reverse mode."""

import dataclasses

import jax
import jax.numpy as jnp

from edhas_jax.compiler.loop_engine import LoopBody


def backward_body(body: LoopBody) -> LoopBody:
    """The loop whose carry are cotangents: w of the carry of `body`, and v of its lane values.

    A step back is  (w, v) ← (wᵀ ∂step/∂carry, v + wᵀ ∂step/∂lane),  with the carry before the step of `body` as sample
    inputs; the samples, of one step each, are to be processed from the last to the first.
    """

    def back(n, cotangents, lane, uniform, before):
        by_carry, by_lane = cotangents
        _, pull = jax.vjp(lambda carry, lane: body.step(n, carry, lane, uniform), before, lane)
        by_carry, share = pull(by_carry)
        return by_carry, jax.tree.map(jnp.add, by_lane, share)

    return dataclasses.replace(body, step=back, carry=(body.carry, body.lane), sample_inputs=body.carry)
