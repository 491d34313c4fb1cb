"""The orifice: flow as a function of pressure drop, its tangent and its inverse."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct


@struct
class Orifice:
    """Turbulent orifice, smooth through zero: Q(A, Δp) = Cd A √(2/ρ) Δp / (Δp² + Δp_t²)^¼.

    In all methods `area` is in m², `drop` a pressure drop in Pa and `density` in kg/m³.

    Source: Borutzky, Barnard, Thoma, Simul. Model. Pract. Theory 10 (2002) 141, for the smooth transition.
    """

    discharge_coefficient: float = par(0.65, "-", (0.05, 1.5), "discharge coefficient Cd")
    transition_pressure: float = par(10e3, "Pa", (1.0, 1e7), "pressure drop of the transition to laminar flow Δp_t")

    def flow(self, area, drop, density):
        """The flow Q [m³/s] through an `area` at a `drop`, of oil of a `density`; odd in the pressure drop."""
        return area * self.conductance(drop, density)[0] * drop

    def conductance(self, drop, density):
        """The conductance per area at a `drop` of oil of a `density`.

        Returns:
            The chord Q/(A Δp) [m/(s·Pa)], the tangent (dQ/dΔp)/A [m/(s·Pa)], and 1/√(Δp² + Δp_t²) [1/Pa].
        """
        inverse = 1.0 / jnp.sqrt(jnp.square(drop) + jnp.square(self.transition_pressure))
        chord = self.discharge_coefficient * jnp.sqrt(2.0 / density) * jnp.sqrt(inverse)
        return chord, chord * (1.0 - 0.5 * jnp.square(drop * inverse)), inverse

    def pressure_drop(self, area, flow, density):
        """The pressure drop Δp [Pa] over an `area` at a `flow` [m³/s] of oil of a `density`; smooth and odd."""
        q = flow / (self.discharge_coefficient * area * jnp.sqrt(2.0 / density))
        square = jnp.square(q)
        root = jnp.sqrt(jnp.square(square) + 4.0 * jnp.square(self.transition_pressure))
        return q * jnp.sqrt(0.5 * (square + root))

    def pressure_drop_in_series(self, area, drop, resistance, density):
        """The part of `drop` [Pa] at an `area` if a laminar `resistance` R [Pa·s/m³] is in series with it.

        The oil has a `density`.

        Four Newton iterations on u + R Q(u) = `drop`. The initial value, that of a fully turbulent orifice, lies on
        the side of the root from which the iteration converges monotonically.
        """
        k = resistance * self.discharge_coefficient * area * jnp.sqrt(2.0 / density)
        size = jnp.sqrt(jnp.square(drop) + jnp.square(self.transition_pressure))
        u = 4.0 * drop * size / jnp.square(k + jnp.sqrt(jnp.square(k) + 4.0 * size))
        for _ in range(4):
            chord, tangent, _ = self.conductance(u, density)
            u = u + (drop - u - resistance * area * chord * u) / (1.0 + resistance * area * tangent)
        return u
