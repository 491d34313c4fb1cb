"""Two tanks in cascade: the model from first principles, and the overflow that this model lacks."""

import jax.numpy as jnp

from edhas_jax import Effect, Rig, drive, par, signal, slot, state


class TwoTanks(Rig):
    """A pump fills the upper tank, which drains through a hole into the lower one, and this into the reservoir.

    u' = g v − k √u, l' = k √u − r k √l (Torricelli's law), levels in volts of the level sensor. The tanks are alike, so
    that a volt is the same water in both, and r is near 1.

    Source: Schoukens, Mattsson, Wigren, Noel, "Cascaded tanks benchmark combining soft and hard nonlinearities", 2016.
    """

    time_step, duration = 2.0, 4000.0  # s

    pump_voltage = drive("V", "voltage of the pump", 3.0)

    outlet: float = par(0.05, "V^0.5/s", (1e-3, 1.0), "k: outflow of the upper tank at a level of 1 V")
    outlet_ratio: float = par(1.0, "-", (0.1, 10.0), "r: the same of the lower tank, over that of the upper one")
    pump_gain: float = par(0.04, "1/s", (1e-3, 1.0), "g: rate of the upper level at 1 V at the pump")
    sensor_zero: float = par(-1.0, "V", (-5.0, 5.0), "reading of the sensor at the level of the lower outlet")
    upper_start: float = par(5.0, "V", (0.01, 50.0), "level of the upper tank at the start")
    lower_start: float = par(6.0, "V", (0.01, 50.0), "level of the lower tank at the start")

    upper_level = state("V", "level of the upper tank", "upper_start")
    lower_level = state("V", "level of the lower tank", "lower_start")
    level = signal("V", "reading of the level sensor of the lower tank")

    upper_loss = slot("upper_tank", "V/s", "water that leaves the upper tank, but not by its hole", "upper_level", 0.02)
    lower_loss = slot("lower_tank", "V/s", "the same of the lower tank", ("lower_level", "upper_level"), 0.02)

    def equations(self, y, s):
        """The rates of both levels [V/s]; sets the reading."""
        between = self.outlet * root(y.upper_level)
        below = self.outlet_ratio * self.outlet * root(y.lower_level)
        s.set(level=y.lower_level + self.sensor_zero)
        return {
            "upper_level": self.pump_gain * s.pump_voltage - between - self.upper_loss.apply(0.0, s),
            "lower_level": between - below - self.lower_loss.apply(0.0, s),
        }


def root(level):
    """The root of a level [V], smooth and odd through an empty tank."""
    return level / jnp.sqrt(jnp.sqrt(jnp.square(level) + 1e-4))


class Overflow(Effect, rig=TwoTanks):
    """Above its rim a tank runs over; of the upper tank's water a share falls into the lower one.

    Source: the curve that `edhas diagnose` finds: nothing below a level, and a steep rise above it.
    """

    upper_rim: float = par(8.0, "V", (0.1, 50.0), "level of the rim of the upper tank", plausible=(4.0, 16.0))
    lower_rim: float = par(10.0, "V", (0.1, 50.0), "reading at the rim of the lower tank", plausible=(9.5, 10.5))
    spill: float = par(0.1, "1/s", (1e-4, 2.0), "rate at which water above a rim leaves", plausible=(0.02, 0.5))
    caught: float = par(0.5, "-", (0.0, 1.0), "share of it that the lower tank catches", plausible=(0.1, 1.0))

    def upper_loss(self, s, z):
        """What runs over the rim of the upper tank [V/s]."""
        return self.spill * jnp.maximum(s.upper_level - self.upper_rim, 0.0)

    def lower_loss(self, s, z):
        """The same of the lower tank, less what it catches of the upper one's [V/s]."""
        over = self.spill * jnp.maximum(s.lower_level + s.sensor_zero - self.lower_rim, 0.0)
        return over - self.caught * self.upper_loss(s, z)


def power_law(level, power):
    """A level [V] to a power, smooth and odd through an empty tank; the unit is that of the factor before it."""
    return jnp.power(jnp.square(level) + 1e-4, 0.5 * power) * jnp.tanh(level / 0.03)


class LowerOutlet(Effect, rig=TwoTanks):
    """The lower tank drains with another power of its level than a hole does: r k s lᵖ in place of r k √l.

    Source: none; found by predicting quarters of the record from the others, see `studies.tanks.discovery`.
    """

    strength: float = par(1.0, "-", (0.01, 20.0), "outflow at 1 V over that of the hole", plausible=(0.2, 5.0))
    power: float = par(0.5, "-", (0.05, 2.5), "exponent of the level", plausible=(0.1, 0.9))

    def lower_loss(self, s, z):
        """What leaves the lower tank beyond the flow of the hole [V/s]."""
        return s.outlet_ratio * s.outlet * (self.strength * power_law(s.lower_level, self.power) - root(s.lower_level))


class UpperOutlet(Effect, rig=TwoTanks):
    """The same of the upper tank, whose water the lower one receives, and a constant draw from the upper tank.

    Source: none; as `LowerOutlet`.
    """

    strength: float = par(1.0, "-", (0.01, 20.0), "outflow at 1 V over that of the hole", plausible=(0.05, 3.0))
    power: float = par(0.5, "-", (0.05, 2.5), "exponent of the level", plausible=(0.2, 1.5))
    draw: float = par(0.05, "V/s", (-1.0, 1.0), "constant outflow that nothing receives", plausible=(-0.2, 0.3))

    def upper_loss(self, s, z):
        """What leaves the upper tank beyond the flow of the hole [V/s]."""
        return self.draw + self._beyond_hole(s)

    def lower_loss(self, s, z):
        """The lower tank receives it, without the constant draw [V/s]."""
        return -self._beyond_hole(s)

    def _beyond_hole(self, s):
        return s.outlet * (self.strength * power_law(s.upper_level, self.power) - root(s.upper_level))
