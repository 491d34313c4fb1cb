"""The orifice law."""

import jax.numpy as jnp

from edhas_jax.tree import par, struct


@struct
class Orifice:
    """Turbulent orifice, smooth through zero: Q(A, Δp) = Cd A √(2/ρ) Δp / (Δp² + Δp_t²)^¼.

    Source: Borutzky, Barnard, Thoma, Simul. Model. Pract. Theory 10 (2002) 141, for the idea of the smooth passage.
    """

    discharge_coefficient: float = par(0.65, "-", (0.05, 1.5), "discharge coefficient Cd")
    transition_pressure: float = par(10e3, "Pa", (1.0, 1e7), "pressure drop of the passage to laminar flow Δp_t")

    def chord(self, area, drop, density):
        """Q/Δp [m³/(s·Pa)] through `area` [m²] at the pressure drop [Pa]; even in the drop."""
        scale = jnp.square(drop) + jnp.square(self.transition_pressure)
        return self.discharge_coefficient * jnp.sqrt(2.0 / density) * area / jnp.sqrt(jnp.sqrt(scale))

    def tangent(self, chord, drop):
        """dQ/dΔp [m³/(s·Pa)]; between half the chord (turbulent) and the whole (laminar)."""
        square = jnp.square(drop)
        return chord * (1.0 - 0.5 * square / (square + jnp.square(self.transition_pressure)))
