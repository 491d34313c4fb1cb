"""Leakage of the check valve seats."""

from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect


class SuctionSeatLeakage(Effect):
    """A worn or dirty seat of each suction valve: Q = orifice(A(y) + A_leak, Δp).

    Source: rated leakage of metal seats, times 1e2 … 1e5 for worn ones.
    """

    looks_like = "flow lost in proportion to the root of the pressure and to time: worst at low frequency under load"
    confused_with = ("delivery_seat_leakage", "piston_clearance", "piston_leakage")
    varies_with = "pressure_drop"

    seat_leakage_area: float = par(
        3e-8, "m^2", (0.0, 1e-3), "area that stays open in each suction valve A_leak", plausible=(1e-9, 3e-7)
    )

    def suction_valve_area(self, s, z):
        return self.seat_leakage_area


class DeliverySeatLeakage(Effect):
    """A worn or dirty seat of each delivery valve: Q = orifice(A(y) + A_leak, Δp).

    Source: rated leakage of metal seats, times 1e2 … 1e5 for worn ones.
    """

    looks_like = "flow back into the chambers during suction, worst at low frequency; outlet pressure falls at rest"
    confused_with = ("suction_seat_leakage", "piston_clearance", "piston_leakage")
    varies_with = "pressure_drop"

    seat_leakage_area: float = par(
        3e-8, "m^2", (0.0, 1e-3), "area that stays open in each delivery valve A_leak", plausible=(1e-9, 3e-7)
    )

    def delivery_valve_area(self, s, z):
        return self.seat_leakage_area
