from edhas_jax import Controller


class Silent(Controller):
    def initial(self):
        return {"x": 0.0}
