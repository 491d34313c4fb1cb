"""The engine that a benchmark asks for, as a user does by the environment variable."""

import os
from unittest import mock

from edhas_jax.compiler import engines


def with_engine(name: str):
    """A context manager within which `EDHAS_ENGINE` has the value `name`."""
    return mock.patch.dict(os.environ, {engines.VARIABLE: name})
