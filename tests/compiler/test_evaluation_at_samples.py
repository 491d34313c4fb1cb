"""One step of a loop at every sample of every lane."""

import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.compiler.engines import compile_loop
from edhas_jax.compiler.loop_engine import LoopBody


def decay(n, carry, lane, uniform):
    """A state that falls at the rate of its lane, and a count of steps."""
    x = carry["x"] * (1.0 - lane["rate"] * uniform["h"]) + jnp.sin(0.1 * n)
    return {"x": x, "steps": carry["steps"] + 1.0}


@pytest.mark.usefixtures("engine")
@pytest.mark.parametrize("lanes", [3, 16, 64])
def test_a_step_at_every_sample_of_every_lane(lanes):
    """What differs from lane to lane, from sample to sample, and what is the same for all, broadcast."""
    samples, rng = 5, np.random.default_rng(0)
    x, rate = rng.normal(size=(samples, lanes)), rng.uniform(size=lanes)
    loop = compile_loop(LoopBody(decay, "float64", {"x": 0.0, "steps": 0.0}, {"rate": 0.0}, {"h": 0.0}))
    carry = {"x": x, "steps": np.arange(samples)[:, None]}
    found = loop.at_samples(carry, {"rate": rate}, {"h": 0.01}, (samples, lanes))
    np.testing.assert_allclose(found["x"], x * (1.0 - rate * 0.01), rtol=1e-14)
    np.testing.assert_array_equal(found["steps"], np.repeat(np.arange(1.0, 6.0)[:, None], lanes, axis=1))
    found = loop.at_samples({"x": 1.0, "steps": 0.0}, {"rate": rate}, {"h": 0.01}, (samples, lanes))
    np.testing.assert_allclose(found["x"], np.tile(1.0 - rate * 0.01, (samples, 1)), rtol=1e-14)
