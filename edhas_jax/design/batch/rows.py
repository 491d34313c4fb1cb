"""A pytree of numbers as one table."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Rows:
    """The leaves of a pytree, all of one shape, as the rows of one `table`.

    A program of XLA takes longer to be handed a hundred arrays than to judge a cycle of a thousand designs.
    """

    table: Any
    structure: Any = dataclasses.field(metadata={"static": True})

    @classmethod
    def of(cls, tree: Any, dtype=None) -> "Rows":
        """The rows of a `tree`: a NumPy array of the type `dtype`, or without one an array of JAX."""
        leaves, structure = jax.tree.flatten(tree)
        return cls(jnp.stack(leaves) if dtype is None else np.array(leaves, dtype), structure)

    @property
    def tree(self) -> Any:
        """The pytree whose leaves are the rows."""
        return jax.tree.unflatten(self.structure, list(self.table))
