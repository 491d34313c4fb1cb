"""The oil: its parameters, its compressibility and the balance of every node."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import OIL_COMPRESSIBILITY, OIL_GAS, OIL_VISCOSITY, apply_slot


@struct
class Oil:
    """Hydraulic oil without bubbles; effects add the rest.

    The state of a node is its pressure p, but its balance is written for the strain pressure w = p − c/p with
    c = a β_f, a the free gas that the effects report (a = α p_atm for entrained air; without gas w = p). w/β_f is the
    volume strain of oil with bubbles up to a logarithm, so that in w the balance is nearly linear, and every finite w
    means p > 0: a chamber that cavitates comes back as soon as oil flows in, at any step.
    """

    oil_density: float = par(860.0, "kg/m^3", (300.0, 2000.0), "density ρ")
    oil_viscosity: float = par(0.040, "Pa*s", (1e-5, 10.0), "dynamic viscosity at 40 °C, μ")
    oil_bulk_modulus: float = par(1.4e9, "Pa", (1e7, 1e11), "bulk modulus without air β_f")
    oil_temperature: float = par(313.15, "K", (223.15, 473.15), "temperature of the oil T, which effects alone look at")
    atmospheric_pressure: float = par(101325.0, "Pa", (1e3, 2e5), "ambient pressure p_atm")

    def pole(self, s: Signals):
        """c [Pa²] of the strain pressure p − c/p, or None without gas."""
        gas = apply_slot(OIL_GAS, None, s)
        return None if gas is None else gas * self.oil_bulk_modulus

    def compressibility(self, pressure, s: Signals):
        """1/β [1/Pa] at `pressure`, with everything that enters the slot."""
        return apply_slot(OIL_COMPRESSIBILITY, 1.0 / self.oil_bulk_modulus, s.with_local(pressure=pressure))

    def viscosity(self, s: Signals):
        """Dynamic viscosity μ [Pa·s], with everything that enters the slot."""
        return apply_slot(OIL_VISCOSITY, self.oil_viscosity, s)

    def rate(self, name: str, flow, volume, s: Signals, extra_capacity=None) -> dict:
        """{name: dw/dt [Pa/s]} of the node whose pressure is the signal `name`: capacity · dp/dt = flow.

        `flow` [m³/s] is the net flow in, less the growth of the volume; capacity = `volume`/β(p) + `extra_capacity`
        [m³/Pa]. The pole is noted for the step, which solves for p itself.
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
        """∫ dp/β between two pressures: Simpson's rule in w, in which the integrand is nearly constant."""
        pole = self.pole(s)
        if pole is None:
            ends = self.compressibility(before, s) + self.compressibility(after, s)
            return (after - before) * (ends + 4.0 * self.compressibility(0.5 * (before + after), s)) / 6.0
        w0, w1 = before - pole / before, after - pole / after
        middle = 0.25 * (w0 + w1) + jnp.sqrt(jnp.square(0.25 * (w0 + w1)) + pole)
        parts = [self.compressibility(p, s) / (1.0 + pole / jnp.square(p)) for p in (before, middle, after)]
        return (w1 - w0) * (parts[0] + 4.0 * parts[1] + parts[2]) / 6.0
