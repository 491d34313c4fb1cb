"""Two tanks in cascade: the model from first principles, without overflow."""

import jax.numpy as jnp

from edhas_jax import Rig, drive, par, signal, slot, state


class TwoTanks(Rig):
    """A pump fills the upper tank, which drains through a hole into the lower one, and this into the reservoir.

    Levels are in volts of the level sensor: u' = −k1 √u + k4 v, l' = k2 √u − k3 √l (Torricelli's law).

    Source: Schoukens, Mattsson, Wigren, Noel, "Cascaded tanks benchmark combining soft and hard nonlinearities", 2016.
    """

    time_step, duration = 2.0, 4000.0  # s

    pump_voltage = drive("V", "voltage of the pump", 3.0)

    upper_outlet = par(0.05, "V^0.5/s", (0.0, 1.0), "k1: outflow of the upper tank at a level of 1 V")
    lower_inlet = par(0.05, "V^0.5/s", (0.0, 1.0), "k2: the same water as a rate of the lower level")
    lower_outlet = par(0.05, "V^0.5/s", (0.0, 1.0), "k3: outflow of the lower tank at a level of 1 V")
    pump_gain = par(0.04, "1/s", (0.0, 1.0), "k4: rate of the upper level at 1 V at the pump")
    sensor_zero = par(0.5, "V", (-5.0, 5.0), "reading of the sensor at an empty tank")
    upper_start = par(5.0, "V", (0.01, 20.0), "level of the upper tank at the start")
    lower_start = par(5.0, "V", (0.01, 20.0), "level of the lower tank at the start")

    upper_level = state("V", "level of the upper tank", "upper_start")
    lower_level = state("V", "level of the lower tank", "lower_start")
    level = signal("V", "reading of the level sensor of the lower tank")

    upper_inflow = slot("upper_tank", "V/s", "added to the rate of the upper level", ("upper_level",), 0.02)
    lower_inflow = slot("lower_tank", "V/s", "added to that of the lower one", ("upper_level", "lower_level"), 0.02)

    def equations(self, y, s):
        upper, lower = root(y.upper_level), root(y.lower_level)
        s.set(level=y.lower_level + self.sensor_zero)
        return {
            "upper_level": self.upper_inflow.apply(self.pump_gain * s.pump_voltage - self.upper_outlet * upper, s),
            "lower_level": self.lower_inflow.apply(self.lower_inlet * upper - self.lower_outlet * lower, s),
        }


def root(level):
    """The root of a level [V], smooth and odd through an empty tank."""
    return level / jnp.sqrt(jnp.sqrt(jnp.square(level) + 1e-4))
