"""The oil: its parameters, its compressibility, and the pressure rate of every oil node."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import OIL_COMPRESSIBILITY, OIL_GAS, OIL_VISCOSITY, apply_slot


@struct
class Oil:
    """Hydraulic oil without gas; effects may add gas, temperature and pressure dependence.

    The state of a node is its pressure p, but its balance is integrated in the strain pressure w = p − c/p with the
    pole c = a β_f, where a is the free gas that effects report (a = α p_atm for entrained air; w = p without gas).
    w/β_f is, up to a logarithm, the volume strain of oil with gas, so that the balance is nearly linear in w, and
    every finite w means p > 0: a cavitating chamber recovers as soon as oil flows in, at any step.
    """

    oil_density: float = par(860.0, "kg/m^3", (300.0, 2000.0), "density ρ")
    oil_viscosity: float = par(0.040, "Pa*s", (1e-5, 10.0), "dynamic viscosity at 40 °C, μ")
    oil_bulk_modulus: float = par(1.4e9, "Pa", (1e7, 1e11), "bulk modulus without air β_f")
    oil_temperature: float = par(313.15, "K", (223.15, 473.15), "temperature of the oil T, which only effects use")
    atmospheric_pressure: float = par(101325.0, "Pa", (1e3, 2e5), "ambient pressure p_atm")

    def pole(self, s: Signals):
        """The pole c [Pa²] of the strain pressure p − c/p, or None without gas."""
        gas = apply_slot(OIL_GAS, None, s)
        return None if gas is None else gas * self.oil_bulk_modulus

    def compressibility(self, pressure, s: Signals):
        """The compressibility 1/β [1/Pa] at `pressure` [Pa], with what effects contribute from the signals `s`."""
        return apply_slot(OIL_COMPRESSIBILITY, 1.0 / self.oil_bulk_modulus, s.with_local(pressure=pressure))

    def viscosity(self, s: Signals):
        """The dynamic viscosity μ [Pa·s], with the contributions of effects."""
        return apply_slot(OIL_VISCOSITY, self.oil_viscosity, s)

    def rate(self, name: str, flow, volume, s: Signals, extra_capacity=None) -> dict:
        """The rate of an oil node: capacity · dp/dt = flow with capacity = volume/β(p) + extra capacity.

        Node, pressure rate and pole are recorded for the step, which solves for p itself.

        Args:
            name: signal of the node's pressure.
            flow: net flow into the node less the rate of its volume [m³/s].
            volume: oil volume [m³].
            s: signals, with the pressure known.
            extra_capacity: capacity beside that of the oil [m³/Pa], or None.

        Returns:
            {name: dw/dt [Pa/s]}, the rate of the strain pressure.
        """
        pressure = getattr(s, name)
        s.record_oil_node(name, pressure, volume, extra_capacity)
        capacity = volume * self.compressibility(pressure, s)
        if extra_capacity is not None:
            capacity = capacity + extra_capacity
        rate = s.record.pressure_rates[name] = flow / capacity
        pole = self.pole(s)
        if pole is None:
            return {name: rate}
        s.record.strain_poles[name] = pole
        return {name: rate * (1.0 + pole / jnp.square(pressure))}

    def strain(self, before, after, s: Signals):
        """The volume strain ∫ dp/β between the pressures `before` and `after` [Pa], by Simpson's rule.

        Effects contribute from the signals `s`.

        The variable of integration is w, in which the integrand is nearly constant.
        """
        pole = self.pole(s)
        if pole is None:
            ends = self.compressibility(before, s) + self.compressibility(after, s)
            return (after - before) * (ends + 4.0 * self.compressibility(0.5 * (before + after), s)) / 6.0
        w0, w1 = before - pole / before, after - pole / after
        middle = 0.25 * (w0 + w1) + jnp.sqrt(jnp.square(0.25 * (w0 + w1)) + pole)
        slopes = [self.compressibility(p, s) / (1.0 + pole / jnp.square(p)) for p in (before, middle, after)]
        return (w1 - w0) * (slopes[0] + 4.0 * slopes[1] + slopes[2]) / 6.0
