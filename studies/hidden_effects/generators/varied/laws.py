"""Laws that differ from those of the library by a random factor: another one in every case.

What an effect of the library contributes is multiplied by

    m(v) = ((v² + 0.05 v₀²)/(1.05 v₀²))^(p/2) · (1 + a v/√(v² + v₀²))

with a variable v of its slot, a typical size v₀ of it, a power p and an asymmetry a, which are drawn for each case.
A power makes a law softer or harder, lets it begin late or early; an asymmetry distinguishes the directions.
"""

from collections.abc import Callable
from typing import Any

import jax.numpy as jnp

from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter, par
from edhas_jax.machine import effects as library
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.interface.slots import SLOTS, Rule
from studies.hidden_effects.generators.laws import FALLING, Law

LARGEST_POWER, LARGEST_ASYMMETRY = 1.0, 0.5
FLOOR = 0.05  # of v₀², so that the factor stays finite at v = 0
SOURCE = "Source: the factor is chosen; real mechanisms follow no textbook law exactly."

# mechanism, slot, variable and its typical size (SI)
PLACES = (
    (library.LugreFriction, "mover_friction", "piston_position", 3e-3),
    (library.PistonLeakage, "chamber_leakage", "chamber_pressure", 0.5e6),
    (library.EntrainedAir, "oil_compressibility", "pressure", 0.5e6),
    (library.ForceConstantDroop, "force_constant_factor", "piston_position", 3e-3),
    (library.MagneticSaturation, "motor_force_factor", "current", 4.0),
    (library.CoggingForce, "mover_force", "piston_position", 3e-3),
    (library.EddyDrag, "mover_force", "piston_velocity", 0.2),
    (library.InverterDeadTime, "coil_voltage_change", "current", 2.0),
    (library.SupplySag, "supply_voltage_change", "current", 4.0),
    (library.ParasiticSpring, "mover_force", "piston_position", 3e-3),
    (library.AsymmetricFriction, "mover_friction", "piston_velocity", 0.2),
    (library.AsymmetricDamping, "mover_force", "piston_velocity", 0.2),
    (library.StrokeDependentFriction, "mover_friction", "piston_position", 3e-3),
    (library.SealFriction, "mover_friction", "chamber_pressure_a", 0.5e6),
    (library.CouplingCompliance, "coupling_force", "coupling_deflection", 30e-6),
    (library.ValveFlowForce, "check_valve_force", "lift", 0.4e-3),
    (library.ValveAdhesion, "check_valve_force", "pressure_drop", 0.2e6),
    (library.SuctionSeatLeakage, "suction_valve_area", "pressure_drop", 0.3e6),
    (library.DeliverySeatLeakage, "delivery_valve_area", "pressure_drop", 0.3e6),
    (library.HoseCompliance, "outlet_capacity", "outlet_pressure", 0.5e6),
    (library.OutletLineResistance, "outlet_line_resistance", "outlet_pressure", 0.5e6),
    (library.SuctionLineResistance, "suction_line_resistance", "piston_velocity", 0.2),
    (library.PressureViscosity, "gap_viscosity_factor", "chamber_pressure", 0.5e6),
    (library.CylinderSealFriction, "cylinder_friction_level", "head_pressure", 0.5e6),
    (library.LoadSpring, "cylinder_force", "cylinder_position", 8e-3),
    (library.CylinderLeakageRise, "cylinder_leakage_change", "head_pressure", 0.5e6),
)  # fmt: skip


def varied_law(mechanism: type[Effect], slot: str, variable: str, size: float) -> Law:
    """A law made from an effect of the library: its contribution at one slot, times a factor that depends on a signal.

    Args:
        mechanism: the effect.
        slot: name of the slot.
        variable: signal over which the factor varies.
        size: typical magnitude of this signal, SI.
    """
    own = structs.parameters(mechanism)
    neutral = 1.0 if SLOTS[slot].rule is Rule.SCALE else 0.0

    def of_library(effect: Effect) -> Effect:
        return mechanism(**{p.name: getattr(effect, p.name) for p in own})

    def contribution(self, s, z):
        value = getattr(of_library(self), slot)(s, z)
        return neutral + (value - neutral) * _factor(getattr(s, variable) / size, self.power, self.asymmetry)

    def other(name: str) -> Callable:
        return lambda self, s, z: getattr(of_library(self), name)(s, z)

    body: dict[str, Any] = {p.name: _copied(p) for p in own}
    body["power"] = par(0.7, "-", (-5.0, 5.0), "p", plausible=(-LARGEST_POWER, LARGEST_POWER))
    body["asymmetry"] = par(0.3, "-", (-1.0, 1.0), "a", plausible=(-LARGEST_ASYMMETRY, LARGEST_ASYMMETRY))
    annotations = dict.fromkeys(body, float)
    body |= mechanism.states | {s.name: other(s.name) for s in mechanism.slots} | {slot: contribution}
    if mechanism.states:
        body["rates"] = other("rates")
    about = f"What `{mechanism.id}` contributes, times a random power of {variable.replace('_', ' ')} and an asymmetry."
    body |= {"__annotations__": annotations, "__doc__": f"{about}\n\n{SOURCE}\n", "__module__": __name__}
    return Law(mechanism, type(f"Varied{mechanism.__name__}", (Effect,), body), falling=mechanism in FALLING)


def _factor(u, power, asymmetry):
    square = u * u
    size = jnp.exp(0.5 * power * jnp.log((square + FLOOR) / (1.0 + FLOOR)))
    return size * (1.0 + asymmetry * u / jnp.sqrt(square + 1.0))


def _copied(p: Parameter) -> Any:
    return par(p.default, p.unit, p.span, p.doc, plausible=p.plausible, at_least=p.at_least)


LAWS = tuple(varied_law(*place) for place in PLACES)
