import jax.numpy as jnp
import numpy as np
from edhas_jax import Controller, par


class Chooses(Controller):
    def command(self, y, s):
        return 12.0 if s.reference > s.piston_position else -12.0


class Forgets(Controller):
    forgetting_time: float = par(1e-3, "s", (1e-6, 1.0), "time of the filter")

    def initial(self):
        return {"seen_error": 0.0, "seen_speed": 0.0}

    def command(self, y, s):
        return 1e4 * y["seen_error"]

    def rates(self, y, s):
        return {"seen_error": (s.reference - s.piston_position - y["seen_error"]) / self.forgetting_time}


class Asks(Controller):
    def command(self, y, s):
        return 1e4 * (s.reference - s.position)


class Takes(Controller):
    def initial(self):
        return {"current": 0.0}

    def command(self, y, s):
        return y["current"]

    def rates(self, y, s):
        return {"current": 0.0}


class Measures(Controller):
    wrong_unit: float = par(1.0, "V per pound of butter", (0.0, 2.0), "gain")

    def command(self, y, s):
        return self.wrong_unit * s.reference


class Misses(Controller):
    def command(self, y, s):
        return y["error"]


class Signs(Controller):
    def command(self, s):
        return 1e4 * s.reference


class Forces(Controller):
    def command(self, y, s):
        return np.float64(1e4) * jnp.asarray(s.reference, float)


class NoController:
    pass
