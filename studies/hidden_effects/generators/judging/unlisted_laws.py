"""Laws of mechanisms that the library does not have, for judging."""

import jax.numpy as jnp

from edhas_jax.core.structs import par
from edhas_jax.machine.effects import Effect, state
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.places import is_chamber_b


class LiftingSeal(Effect):
    """A plunger seal that pressure lifts off, and that closes again with a delay: Q = k (p − p_s) o, o the opening.

    do/dt = ((1 + tanh((p − p_s − p_0)/40 kPa))/2 − o)/6 ms

    Source: lip seals, whose rubber recovers slowly; the form is chosen.
    """

    confused_with = ("piston_leakage", "suction_seat_leakage", "delivery_seat_leakage")

    lifting_conductance: float = par(1e-13, "m^3/(s*Pa)", (0.0, 1e-6), "k", plausible=(5e-15, 5e-12))
    lifting_pressure: float = par(0.25e6, "Pa", (0.0, 1e8), "p_0", plausible=(0.1e6, 0.5e6))

    lifted_a = state("-", "how far the seal of chamber A is lifted, 0 … 1")
    lifted_b = state("-", "the same of chamber B")

    def chamber_leakage(self, s, z):
        lifted = z.lifted_b if is_chamber_b(s) else z.lifted_a
        return self.lifting_conductance * lifted * (s.chamber_pressure - s.accumulator_pressure)

    def rates(self, s, z):
        return {
            f"lifted_{side}": (self._open(s, pressure) - lifted) / 6e-3
            for side, pressure, lifted in (
                ("a", s.chamber_pressure_a, z.lifted_a), ("b", s.chamber_pressure_b, z.lifted_b)
            )
        }  # fmt: skip

    def _open(self, s, pressure):
        return 0.5 * (1.0 + jnp.tanh((pressure - s.accumulator_pressure - self.lifting_pressure) / 40e3))


class CableHysteresis(Effect):
    """Hysteresis of a cable whose strands slide on each other: −F r, dr/dt = v (1 − r sgn v)/δ.

    Source: Dahl, AIAA J. 14 (1976) 1675; for wire ropes Demetriades, Constantinou, Reinhorn, Eng. Structures 15 (1993).
    """

    confused_with = ("parasitic_spring", "asymmetric_friction", "stroke_dependent_friction", "lugre_friction")

    cable_force: float = par(1.0, "N", (0.0, 1e4), "F", plausible=(0.1, 15.0))
    cable_deflection: float = par(1e-3, "m", (1e-6, 1.0), "δ", plausible=(0.4e-3, 2e-3))

    strand_load = state("-", "share of the strands' sliding force")

    def mover_force(self, s, z):
        return -self.cable_force * z.strand_load

    def rates(self, s, z):
        v = s.piston_velocity
        return {"strand_load": (v - jnp.abs(v) * z.strand_load) / self.cable_deflection}


class SweptLubricant(Effect):
    """Dry friction that grows as the guide wipes its grease away: F (1 − exp(−w/w_0)) tanh(v/6 mm/s), dw/dt = |v|.

    Source: starved lubrication, which the distance travelled w since the start makes worse; the form is chosen.
    """

    confused_with = ("lugre_friction", "asymmetric_friction", "stroke_dependent_friction", "coil_heating")

    dry_guide_force: float = par(1.0, "N", (0.0, 1e4), "F", plausible=(0.1, 12.0))
    swept_way: float = par(30e-3, "m", (1e-5, 1e3), "w_0", plausible=(12e-3, 80e-3))

    way = state("m", "distance travelled since the start")

    def mover_friction(self, s, z):
        return self.dry_guide_force * (1.0 - jnp.exp(-z.way / self.swept_way)) * jnp.tanh(s.sliding_velocity / 6e-3)

    def rates(self, s, z):
        return {"way": jnp.abs(s.sliding_velocity)}


class MagneticHysteresis(Effect):
    """Magnetic hysteresis: F_e = Km (i + i_r m), dm/dt = (w − |w| m)/2 A.

    w is the filtered rate of the coil current: w = di_f/dt = (i − i_f)/1 ms.

    Source: Coleman, Hodgdon, Int. J. Eng. Sci. 24 (1986) 897, simplest form.
    """

    confused_with = ("magnetic_saturation", "lugre_friction", "amplifier_lag", "eddy_drag")

    remanent_current: float = par(0.1, "A", (0.0, 1e3), "i_r", plausible=(0.01, 1.0))

    followed_current = state("A", "current i_f")
    magnetisation = state("-", "share of the remanence m")

    def mover_force(self, s, z):
        return s.force_constant * self.remanent_current * z.magnetisation

    def rates(self, s, z):
        rate = (s.current - z.followed_current) / 1e-3
        return {"followed_current": rate, "magnetisation": (rate - jnp.abs(rate) * z.magnetisation) / 2.0}


class CrossoverDistortion(Effect):
    """Crossover distortion of a class B amplifier, a constant voltage drop with the sign of the output.

    −V tanh(u/0.5 V)

    Source: class B amplifiers; Self, Audio Power Amplifier Design (2013); the transition is chosen.
    """

    confused_with = ("inverter_dead_time", "supply_sag", "amplifier_lag")

    crossover_voltage: float = par(0.3, "V", (0.0, 100.0), "V", plausible=(0.02, 1.5))

    def coil_voltage_change(self, s, z):
        return -self.crossover_voltage * jnp.tanh(s.voltage / 0.5)


class PressedBall(Effect):
    """Friction of valve balls that the flow presses against their guide: −F tanh(ẏ/10 mm/s) |Δp|/0.2 MPa.

    Source: side forces of an uneven flow around the ball, and Coulomb's law; the form is chosen.
    """

    confused_with = ("valve_adhesion", "valve_flow_force")

    guide_friction: float = par(0.05, "N", (0.0, 1e4), "F", plausible=(0.005, 0.8))

    def check_valve_force(self, s, z):
        return -self.guide_friction * jnp.tanh(s.lift_velocity / 0.01) * jnp.abs(s.pressure_drop) / 0.2e6


class ChargedDamper(Effect):
    """A pulsation damper with a gas charge: capacity C (p_0/p)² above the charge pressure p_0, none below (±30 kPa).

    Source: Boyle's law for the gas of a pulsation damper.
    """

    confused_with = ("hose_compliance", "entrained_air")

    gas_capacity: float = par(1e-13, "m^3/Pa", (0.0, 1e-8), "C", plausible=(1e-15, 5e-12))
    charge_pressure: float = par(0.4e6, "Pa", (1e3, 1e8), "p_0", plausible=(0.25e6, 0.48e6))

    def outlet_capacity(self, s, z):
        free = 0.5 * (1.0 + jnp.tanh((s.outlet_pressure - self.charge_pressure) / 30e3))
        return self.gas_capacity * free * jnp.square(self.charge_pressure / s.outlet_pressure)


class CushionedCylinder(Effect):
    """End-position cushioning, which damps the cylinder the more, the further out it is: −c v_c (x_c/8 mm)³.

    Source: tapered cushioning spears; the form is chosen.
    """

    confused_with = ("load_spring", "cylinder_seal_friction", "cylinder_leakage_rise")

    cushion_damping: float = par(100.0, "N*s/m", (0.0, 1e7), "c", plausible=(5.0, 2e3))

    def cylinder_force(self, s, z):
        u = jnp.maximum(s.cylinder_position, 0.0) / 8e-3
        return -self.cushion_damping * s.cylinder_velocity * u * u * u


LAWS = tuple(
    Law(None, kind)
    for kind in (
        LiftingSeal, CableHysteresis, SweptLubricant, MagneticHysteresis, CrossoverDistortion, PressedBall,
        ChargedDamper, CushionedCylinder,
    )
)  # fmt: skip
