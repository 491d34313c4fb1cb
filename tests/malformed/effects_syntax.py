from edhas_jax.effects import Effect


class SealDrag(Effect)
    pass
