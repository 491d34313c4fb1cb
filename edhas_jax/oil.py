"""The oil: its parameters, its compressibility and the pressure coordinate of every node."""

import jax.numpy as jnp

from edhas_jax.signals import Signals
from edhas_jax.slots import OIL_COMPRESSIBILITY, OIL_GAS, OIL_VISCOSITY, enter
from edhas_jax.tree import par, struct


@struct
class Oil:
    """Hydraulic oil without bubbles; effects add the rest.

    A node with pressure p keeps as its state not p but the coordinate w = p − c/p with c = a β_f, a the free gas
    that the effects report (a = α p_atm for entrained air; without gas w = p). w/β_f is the volume strain of oil with
    bubbles up to a logarithm, so that in w the balance of a node is nearly linear, and every finite w means p > 0: a
    chamber that cavitates comes back as soon as oil flows in, at any step.
    """

    oil_density: float = par(860.0, "kg/m^3", (300.0, 2000.0), "density ρ")
    oil_viscosity: float = par(0.040, "Pa*s", (1e-5, 10.0), "dynamic viscosity μ")
    oil_bulk_modulus: float = par(1.4e9, "Pa", (1e7, 1e11), "bulk modulus without air β_f")
    atmospheric_pressure: float = par(101325.0, "Pa", (1e3, 2e5), "ambient pressure p_atm")

    def _pole(self, s: Signals):
        gas = enter(OIL_GAS, None, s)
        return None if gas is None else gas * self.oil_bulk_modulus

    def coordinate(self, pressure, s: Signals):
        """The state w [Pa] of a node at `pressure` [Pa, absolute]."""
        pole = self._pole(s)
        return pressure if pole is None else pressure - pole / pressure

    def pressure(self, w, s: Signals):
        """The pressure [Pa, absolute] of a node with state w [Pa]."""
        pole = self._pole(s)
        if pole is None:
            return w
        root = jnp.sqrt(jnp.square(w) + 4.0 * pole)
        # the two forms are equal; each is free of cancellation on its side of zero
        return jnp.where(w > 0.0, 0.5 * (root + w), 2.0 * pole / (root + jnp.abs(w)))

    def compressibility(self, pressure, s: Signals):
        """1/β [1/Pa] at `pressure`, with everything that enters the slot."""
        return enter(OIL_COMPRESSIBILITY, 1.0 / self.oil_bulk_modulus, s.at(pressure=pressure))

    def viscosity(self, s: Signals):
        """Dynamic viscosity μ [Pa·s], with everything that enters the slot."""
        return enter(OIL_VISCOSITY, self.oil_viscosity, s)

    def rate(self, pressure, flow, volume, s: Signals, extra_capacity=None):
        """dw/dt [Pa/s] of a node: capacity · dp/dt = flow, capacity = volume/β(p) + `extra_capacity`.

        `flow` [m³/s] is the net flow in, less the growth of the volume; `volume` in m³; capacities in m³/Pa.
        """
        capacity = volume * self.compressibility(pressure, s)
        if extra_capacity is not None:
            capacity = capacity + extra_capacity
        pole = self._pole(s)
        rate = flow / capacity
        return rate if pole is None else rate * (1.0 + pole / jnp.square(pressure))
