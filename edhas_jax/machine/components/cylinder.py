"""The double-rod cylinder with its load, and the reversing valve that feeds it."""

import jax.numpy as jnp

from edhas_jax.core.structs import par, struct
from edhas_jax.machine.components import PAPER


@struct
class ReversingValve:
    """4/3 valve with a first-order spool: dw/dt = (w_cmd − w)/τ, four edges of area A_rv |w|."""

    reversing_valve_area: float = par(6e-6, "m^2", (1e-10, 1e-2), "area of an edge at full opening A_rv")
    reversing_valve_time: float = par(8e-3, "s", (1e-5, 10.0), "time constant of the spool τ_rv")

    def areas(self, spool):
        """Areas [m²] of the edges that are open for w > 0 (P→head, rod→T) and for w < 0 (P→rod, head→T)."""
        return (
            self.reversing_valve_area * jnp.maximum(spool, 0.0),
            self.reversing_valve_area * jnp.maximum(-spool, 0.0),
        )


@struct
class Cylinder:
    """Double-rod cylinder: one effective area A = π (D² − d_rod²)/4, leakage K_il between its chambers."""

    cylinder_bore: float = par(30e-3, "m", (1e-3, 2.0), "bore D", PAPER, at_least="cylinder_rod")
    cylinder_rod: float = par(20e-3, "m", (0.0, 2.0), "rod diameter d_rod", PAPER)
    cylinder_stroke: float = par(20e-3, "m", (1e-4, 20.0), "travel s_c", PAPER)
    cylinder_dead_volume: float = par(5.01e-6, "m^3", (1e-9, 1.0), "port and hose of one side V_dc")
    cylinder_leakage: float = par(1e-13, "m^3/(s*Pa)", (0.0, 1e-6), "leakage conductance between the sides K_il")
    load_mass: float = par(1.0, "kg", (1e-3, 1e5), "mass of rod and load M_a")
    cylinder_damping: float = par(100.0, "N*s/m", (0.0, 1e7), "viscous damping c_a")
    load_force: float = par(0.0, "N", (-1e6, 1e6), "external force against x_c > 0, F_load")

    def area(self):
        """The effective area A = π (D² − d_rod²)/4 [m²], one for both sides as Eq. (10) implies.

        Source: Actuators 2022, 11(10), 281, Eq. (10).
        """
        return 0.25 * jnp.pi * (jnp.square(self.cylinder_bore) - jnp.square(self.cylinder_rod))
