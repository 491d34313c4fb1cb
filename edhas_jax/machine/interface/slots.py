"""The slots: the places where an effect may add to the equations, how it does, and which curves can be drawn there.

An effect acts at a slot by defining a method of the slot's name; the equations call `apply_slot` at each slot.
"""

import enum
from typing import NamedTuple

from edhas_jax.machine.interface.signals import Signals


class Rule(enum.Enum):
    """How contributions combine; both rules commute, so the order of effects cannot matter."""

    ADD = "add"
    SCALE = "scale"


class Slot(NamedTuple):
    """A place in the equations where an effect may contribute, by a method of the slot's name.

    Attributes:
        name: name of the slot and of the effect's method.
        location: section of the machine.
        unit: SI unit of a contribution, "-" for a factor.
        rule: how contributions combine.
        doc: what a contribution does.
        local_signals: signals that exist at this slot beside those of the whole machine.
        over: the signals over which a curve can be drawn there, the most usual first; behind a colon the signals by
            which the curve is multiplied.
        typical_size: the size of a contribution that matters, in `unit`: about what effects of the library contribute
            at their plausible values.
        is_exclusive: whether it takes one effect only, since a second coupling or line there would have no physical
            meaning. Such a slot gives the machine further states or nodes: a curve alone is no model.
        same_as: name of the slot at which a curve is the same term of the same equation, but for its sign.
    """

    name: str
    location: str
    unit: str
    rule: Rule
    doc: str
    local_signals: tuple[str, ...] = ()
    over: tuple[str, ...] = ()
    typical_size: float = 1.0
    is_exclusive: bool = False
    same_as: str = ""

    def apply(self, base, s: Signals):
        """See `apply_slot`."""
        return apply_slot(self, base, s)


def slot(
    location: str, unit: str, doc: str, over: str | tuple[str, ...] = (), typical_size: float = 1.0, *,
    scales: bool = False,
) -> Slot:  # fmt: skip
    """Declare a slot of a rig of one's own, to be assigned to a class attribute, which names it.

    Args:
        location: part of the machine, by the name that its picture in a report has.
        unit: SI unit of a contribution, "-" for a factor.
        doc: what a contribution does.
        over: signals over which a curve can be drawn there, the most usual first.
        typical_size: size of a contribution that matters, in `unit`.
        scales: whether contributions are multiplied; else they are added.
    """
    over = (over,) if isinstance(over, str) else tuple(over)
    return Slot("", location, unit, Rule.SCALE if scales else Rule.ADD, doc, (), over, typical_size)


_OVER_COIL = ("current", "piston_velocity", "piston_position", "voltage")
_OVER_CYLINDER = ("cylinder_velocity", "cylinder_position", "head_pressure")

SUPPLY_VOLTAGE = Slot(
    "supply_voltage_change", "coil", "V", Rule.ADD, "added to the voltage limit of the supply",
    over=("current", "voltage"), typical_size=1.0,
)
COIL_VOLTAGE = Slot(
    "coil_voltage_change", "coil", "V", Rule.ADD, "added to the voltage at the coil", over=_OVER_COIL, typical_size=0.3
)
COIL_RESISTANCE = Slot(
    "coil_resistance_factor", "coil", "-", Rule.SCALE, "multiplies the coil resistance",
    over=_OVER_COIL, typical_size=0.1,
)
COIL_INDUCTANCE = Slot(
    "coil_inductance_factor", "coil", "-", Rule.SCALE, "multiplies the coil inductance",
    over=("piston_position", "current"), typical_size=0.1,
)
FORCE_CONSTANT = Slot(
    "force_constant_factor", "coil", "-", Rule.SCALE, "multiplies Km in force and back-EMF",
    over=("piston_position", "current"), typical_size=0.1,
)
MOTOR_FORCE = Slot(
    "motor_force_factor", "mover", "-", Rule.SCALE, "multiplies the motor force, not the back-EMF",
    over=("current", "piston_position"), typical_size=0.1,
)
MOVER_FORCE = Slot(
    "mover_force", "mover", "N", Rule.ADD, "force on the mover, positive along x",
    over=("piston_position", "piston_velocity", "current", "chamber_pressure_a", "piston_position:current",
          "piston_position:piston_velocity", "piston_position:current:current"),
    typical_size=1.0,
)
MOVER_FRICTION = Slot(
    "mover_friction", "mover", "N", Rule.ADD, "friction on the mover, positive when it opposes v > 0",
    over=("piston_velocity", "piston_position", "current", "chamber_pressure_a", "piston_position:piston_velocity",
          "piston_velocity:outlet_pressure"),
    typical_size=1.0, same_as="mover_force",
)
# with this slot in use, coil carrier and plungers are two bodies and the machine has two more states
COUPLING_FORCE = Slot(
    "coupling_force", "mover", "N", Rule.ADD, "force from coil carrier to plungers, which become two masses",
    ("coupling_deflection", "coupling_velocity"), over=("coupling_deflection", "coupling_velocity"), typical_size=10.0,
    is_exclusive=True,
)
CHECK_VALVE_FORCE = Slot(
    "check_valve_force", "check_valves", "N", Rule.ADD, "force on the ball, positive in the opening direction",
    ("lift", "lift_velocity", "pressure_drop", "valve_area"),
    over=("lift", "pressure_drop", "lift_velocity", "lift:pressure_drop", "lift:lift_velocity"), typical_size=0.05,
)
SUCTION_VALVE_AREA = Slot(
    "suction_valve_area", "check_valves", "m^2", Rule.ADD, "added to the flow area of a suction valve",
    ("lift", "lift_velocity", "pressure_drop"), over=("lift", "pressure_drop"), typical_size=1e-7,
)
DELIVERY_VALVE_AREA = Slot(
    "delivery_valve_area", "check_valves", "m^2", Rule.ADD, "added to the flow area of a delivery valve",
    ("lift", "lift_velocity", "pressure_drop"), over=("lift", "pressure_drop"), typical_size=1e-7,
)
CHAMBER_LEAKAGE = Slot(
    "chamber_leakage", "chamber", "m^3/s", Rule.ADD, "flow out of a pump chamber to the accumulator",
    ("chamber_pressure", "plunger_velocity", "viscosity"),
    over=("chamber_pressure", "plunger_velocity", "plunger_velocity:chamber_pressure"), typical_size=2e-7,
)
# the viscosity in a plunger gap depends on the pressure there, which differs between the chambers
GAP_VISCOSITY = Slot(
    "gap_viscosity_factor", "oil", "-", Rule.SCALE, "multiplies the viscosity of the oil in the gap of a plunger",
    ("chamber_pressure",), over=("chamber_pressure",), typical_size=0.1,
)
# with this slot in use, the manifold before the suction valves is one more oil node
SUCTION_LINE_RESISTANCE = Slot(
    "suction_line_resistance", "suction", "Pa*s/m^3", Rule.ADD,
    "resistance between accumulator and suction valves; adds a manifold of 10 mL before the valves",
    over=("piston_velocity",), typical_size=3e8, is_exclusive=True,
)
SUCTION_LINE_FLOW = Slot(
    "suction_line_flow", "suction", "m^3/s", Rule.ADD, "flow of a suction line whose oil has inertia",
    is_exclusive=True,
)
# a line in series with the load orifice takes part of the pressure drop
OUTLET_LINE_RESISTANCE = Slot(
    "outlet_line_resistance", "outlet", "Pa*s/m^3", Rule.ADD, "resistance in series with the load orifice",
    over=("outlet_pressure",), typical_size=3e8,
)
OUTLET_LINE_FLOW = Slot(
    "outlet_line_flow", "outlet", "m^3/s", Rule.ADD, "flow of an outlet line whose oil has inertia", is_exclusive=True
)
OUTLET_CAPACITY = Slot(
    "outlet_capacity", "outlet", "m^3/Pa", Rule.ADD, "added to the capacity V/β of the outlet node",
    over=("outlet_pressure",), typical_size=1e-12,
)
OIL_COMPRESSIBILITY = Slot(
    "oil_compressibility", "oil", "1/Pa", Rule.ADD, "added to 1/β of the oil at the pressure of a node", ("pressure",),
    over=("pressure",), typical_size=1e-10,
)
OIL_GAS = Slot(
    "oil_gas", "oil", "Pa", Rule.ADD,
    "free gas a in the oil, with compressibility a/p² at low pressure; determines the strain pressure",
)
OIL_VISCOSITY = Slot(
    "oil_viscosity_factor", "oil", "-", Rule.SCALE, "multiplies the viscosity of the oil",
    over=("piston_velocity",), typical_size=0.1,
)
CYLINDER_FORCE = Slot(
    "cylinder_force", "cylinder", "N", Rule.ADD, "force on the cylinder, positive along x_c",
    over=_OVER_CYLINDER, typical_size=10.0,
)
CYLINDER_FRICTION = Slot(
    "cylinder_friction_force", "cylinder", "N", Rule.ADD, "friction on the cylinder, positive when it opposes v_c > 0",
    ("cylinder_free_force", "cylinder_friction_level"), over=_OVER_CYLINDER, typical_size=10.0,
    same_as="cylinder_force",
)
CYLINDER_FRICTION_LEVEL = Slot(
    "cylinder_friction_level", "cylinder", "N", Rule.ADD, "added to both dry friction levels of the cylinder",
    over=_OVER_CYLINDER, typical_size=10.0,
)
CYLINDER_LEAKAGE = Slot(
    "cylinder_leakage_change", "cylinder", "m^3/(s*Pa)", Rule.ADD, "added to the leakage conductance of the cylinder",
    over=_OVER_CYLINDER, typical_size=1e-13,
)

_COIL = (SUPPLY_VOLTAGE, COIL_VOLTAGE, COIL_RESISTANCE, COIL_INDUCTANCE, FORCE_CONSTANT)
_MOVER = (MOTOR_FORCE, MOVER_FORCE, MOVER_FRICTION)
_PUMP = (
    COUPLING_FORCE, CHECK_VALVE_FORCE, SUCTION_VALVE_AREA, DELIVERY_VALVE_AREA, CHAMBER_LEAKAGE, GAP_VISCOSITY,
    SUCTION_LINE_RESISTANCE, SUCTION_LINE_FLOW, OUTLET_CAPACITY, OIL_COMPRESSIBILITY, OIL_GAS, OIL_VISCOSITY,
)  # fmt: skip
_LOAD = (OUTLET_LINE_RESISTANCE, OUTLET_LINE_FLOW)
_CYLINDER = (CYLINDER_FORCE, CYLINDER_FRICTION, CYLINDER_FRICTION_LEVEL, CYLINDER_LEAKAGE)

ACTUATOR_SLOTS = _COIL + _MOVER
PUMP_SLOTS = ACTUATOR_SLOTS + _PUMP + _LOAD
SYSTEM_SLOTS = ACTUATOR_SLOTS + _PUMP + _CYLINDER
SLOTS: dict[str, Slot] = {slot.name: slot for slot in PUMP_SLOTS + _CYLINDER}


def is_used(slot: Slot, effects: tuple) -> bool:
    """Whether one of the effects acts at `slot`."""
    return any(hasattr(effect, slot.name) for effect in effects)


def apply_slot(slot: Slot, base, s: Signals):
    """Combine `base` with the contributions of all effects at `slot`.

    Without an effect at the slot the result is `base` itself, without one operation. Each contribution is also
    recorded in `s.record.contributions[slot.name]` by effect id, for the energy balance per effect.

    Args:
        slot: the slot.
        base: value without effects in the slot's unit; None where the term exists only by an effect.
        s: the signals at this point of the equations, with the local signals of the slot.

    Returns:
        The combined value; None if `base` is None and no effect acts at the slot.
    """
    for effect, states in s.effects:
        contribute = getattr(effect, slot.name, None)
        if contribute is None:
            continue
        value = contribute(s, states)
        s.record.contributions.setdefault(slot.name, {}).setdefault(effect.id, []).append(value)
        if base is None:
            base = value
        else:
            base = base + value if slot.rule is Rule.ADD else base * value
    return base
