"""Laws of mechanisms that the library does not have, for the earlier judging set."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.functions import arctan
from studies.hidden_effects.generators.laws import Law


class WobblingPlunger(Effect):
    """Leakage that grows with speed, as a plunger is lifted off its bore: Q = k |v|/0.2 m/s (p − p_s).

    Source: eccentricity that follows the motion; the form is chosen.
    """

    confused_with = ("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage")

    wobble_conductance: float = par(1e-13, "m^3/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-15, 3e-12))

    def chamber_leakage(self, s, z):
        share = jnp.abs(s.plunger_velocity) / 0.2
        return self.wobble_conductance * share * (s.chamber_pressure - s.accumulator_pressure)


class PressedGuide(Effect):
    """Viscous drag of a guide that the pressure difference loads: −c v |p_A − p_B|/0.5 MPa.

    Source: side load of a plunger in proportion to its axial load; the form is chosen.
    """

    confused_with = ("seal_friction", "eddy_drag", "asymmetric_damping")

    guide_drag: float = par(5.0, "N*s/m", (0.0, 1e5), "c", plausible=(0.3, 80.0))

    def mover_force(self, s, z):
        load = jnp.abs(s.chamber_pressure_a - s.chamber_pressure_b) / 0.5e6
        return -self.guide_drag * s.piston_velocity * load


class BrushContact(Effect):
    """A sliding contact whose drop grows with speed: −R (|v|/0.2 m/s) i.

    Source: carbon brushes, whose contact drop rises with speed; Holm, Electric Contacts (1967); the form is chosen.
    """

    confused_with = ("inverter_dead_time", "coil_heating", "supply_sag")

    contact_resistance: float = par(0.1, "ohm", (0.0, 1e3), "R", plausible=(0.005, 1.5))

    def coil_resistance_factor(self, s, z):
        return 1.0 + self.contact_resistance * jnp.abs(s.piston_velocity) / 0.2 / s.coil_resistance


class RubbingValveSpring(Effect):
    """Friction of the valve springs, which grows with the lift: −F (2/π) atan(ẏ/20 mm/s) y/(y + 0.2 mm).

    Source: structural damping of coil springs whose turns rub at their seats; the form is chosen.
    """

    confused_with = ("valve_adhesion", "valve_flow_force")

    rubbing_force: float = par(0.05, "N", (0.0, 1e4), "F", plausible=(0.01, 1.0))

    def check_valve_force(self, s, z):
        branch = 2.0 / jnp.pi * arctan(s.lift_velocity / 0.02)
        return -self.rubbing_force * branch * jnp.maximum(s.lift, 0.0) / (jnp.maximum(s.lift, 0.0) + 0.2e-3)


class DelayedField(Effect):
    """A magnetic field that lags the current: F_e = Km (i + ε (i − i_s)), di_s/dt = (i − i_s)/τ, τ = 1.5 ms.

    Source: flux diffusion in solid iron, with one time constant.
    """

    confused_with = ("magnetic_saturation", "amplifier_lag", "force_constant_droop")

    field_lag: float = par(0.05, "-", (-1.0, 1.0), "ε", plausible=(0.01, 0.5))

    field_current = state("A", "current that the field follows")

    def mover_force(self, s, z):
        return -self.field_lag * s.force_constant * (s.current - z.field_current)

    def rates(self, s, z):
        return {"field_current": (s.current - z.field_current) / 1.5e-3}


class StoppedDamper(Effect):
    """A damper in the outlet that reaches its stop at 0.45 MPa: capacity C below, none above, within 50 kPa.

    Source: a diaphragm damper; the form is chosen.
    """

    confused_with = ("hose_compliance", "entrained_air")

    pocket: float = par(1e-12, "m^3/Pa", (0.0, 1e-8), "C", plausible=(2e-14, 2e-11))

    def outlet_capacity(self, s, z):
        return self.pocket * 0.5 * (1.0 - jnp.tanh((s.outlet_pressure - 0.45e6) / 50e3))


LAWS = tuple(
    Law(None, kind)
    for kind in (WobblingPlunger, PressedGuide, BrushContact, RubbingValveSpring, DelayedField, StoppedDamper)
)
