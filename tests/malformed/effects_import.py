from edhas_jax.effects import Effect

LIMIT = 1 / 0


class SealDrag(Effect):
    pass
