"""The orifice law."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


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

    def pressure_drop(self, area, flow, density):
        """Δp [Pa] at which `area` [m²] lets `flow` [m³/s] through: the inverse of `flow`, smooth and odd."""
        q = flow / (self.discharge_coefficient * area * jnp.sqrt(2.0 / density))
        square = jnp.square(q)
        root = jnp.sqrt(jnp.square(square) + 4.0 * jnp.square(self.transition_pressure))
        return q * jnp.sqrt(0.5 * (square + root))

    def pressure_drop_in_series(self, area, drop, resistance, density):
        """The share of `drop` [Pa] at the orifice when a laminar `resistance` [Pa·s/m³] is in series with it.

        Newton's method on u + R Q(u) = `drop`; its start, the drop at a fully turbulent orifice, lies on the side of
        the root from which it converges monotonically.
        """
        k = resistance * self.discharge_coefficient * area * jnp.sqrt(2.0 / density)
        size = jnp.sqrt(jnp.square(drop) + jnp.square(self.transition_pressure))
        u = 4.0 * drop * size / jnp.square(k + jnp.sqrt(jnp.square(k) + 4.0 * size))
        for _ in range(4):
            chord, tangent, _ = self.conductance(u, density)
            u = u + (drop - u - resistance * area * chord * u) / (1.0 + resistance * area * tangent)
        return u
