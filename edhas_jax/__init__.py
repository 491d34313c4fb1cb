"""Design an electro-hydraulic actuator, and find out why the real one does not behave like the model."""

from edhas_jax import backend as _backend  # first: it sets compiler flags, which JAX reads only once

_backend.prepare()

__version__ = "0.1.0"
