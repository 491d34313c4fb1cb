from edhas_jax import Effect


class SealDrag(Effect):
    def mover_frction(self, s, z):
        return 0.0
