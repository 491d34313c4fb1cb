from edhas_jax import Effect

LIMIT = 1 / 0


class SealDrag(Effect):
    pass
