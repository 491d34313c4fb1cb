from edhas_jax import Effect


class SealDrag(Effect)
    pass
