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

    def flow(self, area, drop, density):
        """Q [m³/s] through `area` [m²] at the pressure drop [Pa]; odd in the drop."""
        return area * self.conductance(drop, density)[0] * drop

    def conductance(self, drop, density):
        """Q/(A Δp) [m/(s·Pa)], its tangent dQ/dΔp / A, and 1/√(Δp² + Δp_t²) [1/Pa]."""
        inverse = 1.0 / jnp.sqrt(jnp.square(drop) + jnp.square(self.transition_pressure))
        chord = self.discharge_coefficient * jnp.sqrt(2.0 / density) * jnp.sqrt(inverse)
        return chord, chord * (1.0 - 0.5 * jnp.square(drop * inverse)), inverse
