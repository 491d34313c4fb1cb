"""A loop over time as machine code of this processor: many lanes side by side, all numbers in registers.

`Loop` takes the body of a loop, written in JAX for scalars, and compiles it with LLVM; a body that uses operations
beyond its reach is `Untranslatable`. `each` shares work among threads. Nothing here knows of
machines.
"""

from edhas_jax.native.adjoint import AdjointLoop
from edhas_jax.native.loop import Loop, Marched
from edhas_jax.native.reading import Untranslatable
from edhas_jax.native.side_by_side import each

__all__ = ["AdjointLoop", "Loop", "Marched", "Untranslatable", "each"]
