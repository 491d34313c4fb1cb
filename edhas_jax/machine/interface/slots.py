"""The closed list of places where physics may enter the equations."""

import enum
from typing import NamedTuple

from edhas_jax.machine.interface.signals import Signals


class Rule(enum.Enum):
    """How contributions combine; both rules commute, so the order of effects cannot matter."""

    ADD = "add"
    SCALE = "scale"


class Slot(NamedTuple):
    """A place where physics may enter: an effect enters it by a method of this name.

    `where` is the part of the machine; `unit` the SI unit of a contribution ("-" for a factor); `local` the signals
    that exist at this place beside those of the whole machine.
    """

    name: str
    where: str
    unit: str
    rule: Rule
    doc: str
    local: tuple[str, ...] = ()


SUPPLY_VOLTAGE = Slot("supply_voltage_change", "coil", "V", Rule.ADD, "added to the voltage limit of the supply")
COIL_VOLTAGE = Slot("coil_voltage_change", "coil", "V", Rule.ADD, "added to the voltage that the coil sees")
COIL_RESISTANCE = Slot("coil_resistance_factor", "coil", "-", Rule.SCALE, "multiplies the coil resistance")
COIL_INDUCTANCE = Slot("coil_inductance_factor", "coil", "-", Rule.SCALE, "multiplies the coil inductance")
FORCE_CONSTANT = Slot("force_constant_factor", "coil", "-", Rule.SCALE, "multiplies Km in force and back-EMF")
MOTOR_FORCE = Slot("motor_force_factor", "mover", "-", Rule.SCALE, "multiplies the motor force, not the back-EMF")
MOVER_FORCE = Slot("mover_force", "mover", "N", Rule.ADD, "force on the mover, positive along x")
MOVER_FRICTION = Slot("mover_friction", "mover", "N", Rule.ADD, "friction on the mover, positive when it opposes v > 0")
# a coil carrier and plungers that are not one body have two positions: the machine then has two more states
COUPLING_FORCE = Slot(
    "coupling_force", "mover", "N", Rule.ADD, "force from coil carrier to plungers, which with it are two masses",
    ("coupling_deflection", "coupling_velocity"),
)
CHECK_VALVE_FORCE = Slot(
    "check_valve_force", "check_valves", "N", Rule.ADD, "force on the ball, positive in the opening direction",
    ("lift", "lift_velocity", "pressure_drop", "valve_area"),
)
SUCTION_VALVE_AREA = Slot(
    "suction_valve_area", "check_valves", "m^2", Rule.ADD, "added to the flow area of a suction valve",
    ("lift", "lift_velocity", "pressure_drop"),
)
DELIVERY_VALVE_AREA = Slot(
    "delivery_valve_area", "check_valves", "m^2", Rule.ADD, "added to the flow area of a delivery valve",
    ("lift", "lift_velocity", "pressure_drop"),
)
CHAMBER_LEAKAGE = Slot(
    "chamber_leakage", "chamber", "m^3/s", Rule.ADD, "flow out of a pump chamber to the accumulator",
    ("chamber_pressure", "plunger_velocity", "viscosity"),
)
# the gap of a plunger has a pressure of its own, which the viscosity of the machine cannot know
GAP_VISCOSITY = Slot(
    "gap_viscosity_factor", "oil", "-", Rule.SCALE, "multiplies the viscosity of the oil in the gap of a plunger",
    ("chamber_pressure",),
)
# a line ends in a volume of oil before the valves, a node that the step must solve for as for any other
SUCTION_LINE_RESISTANCE = Slot(
    "suction_line_resistance", "suction", "Pa*s/m^3", Rule.ADD,
    "resistance between accumulator and suction valves; with it a manifold of 10 mL stands before the valves",
)
SUCTION_LINE_FLOW = Slot(
    "suction_line_flow", "suction", "m^3/s", Rule.ADD, "flow of a suction line whose oil has inertia",
)  # fmt: skip
# the flow of the load follows from its pressure drop only where nothing is in series with it
OUTLET_LINE_RESISTANCE = Slot(
    "outlet_line_resistance", "outlet", "Pa*s/m^3", Rule.ADD, "resistance in series with the load orifice"
)
OUTLET_LINE_FLOW = Slot(
    "outlet_line_flow", "outlet", "m^3/s", Rule.ADD, "flow of an outlet line whose oil has inertia"
)
OUTLET_CAPACITY = Slot("outlet_capacity", "outlet", "m^3/Pa", Rule.ADD, "added to the capacity V/β of the outlet node")
OIL_COMPRESSIBILITY = Slot(
    "oil_compressibility", "oil", "1/Pa", Rule.ADD, "added to 1/β of the oil at the pressure of a node", ("pressure",)
)
OIL_GAS = Slot(
    "oil_gas", "oil", "Pa", Rule.ADD,
    "free gas in the oil as a, where the compressibility goes as a/p² at low pressure: chooses the pressure coordinate",
)
OIL_VISCOSITY = Slot("oil_viscosity_factor", "oil", "-", Rule.SCALE, "multiplies the viscosity of the oil")
CYLINDER_FORCE = Slot("cylinder_force", "cylinder", "N", Rule.ADD, "force on the cylinder, positive along x_c")
CYLINDER_FRICTION = Slot(
    "cylinder_friction_force", "cylinder", "N", Rule.ADD, "friction on the cylinder, positive when it opposes v_c > 0",
    ("cylinder_free_force", "cylinder_friction_level"),
)
CYLINDER_FRICTION_LEVEL = Slot(
    "cylinder_friction_level", "cylinder", "N", Rule.ADD, "added to both dry friction levels of the cylinder"
)
CYLINDER_LEAKAGE = Slot(
    "cylinder_leakage_change", "cylinder", "m^3/(s*Pa)", Rule.ADD, "added to the leakage conductance of the cylinder"
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


def taken(slot: Slot, effects: tuple) -> bool:
    """Whether one of the effects of a machine enters `slot`."""
    return any(hasattr(effect, slot.name) for effect in effects)


def enter(slot: Slot, base, s: Signals):
    """`base` with everything that enters `slot`; exactly `base`, and not one operation, when nothing does.

    Each contribution is also kept under the effect's id in `s.notes.contributions[slot.name]`, which is what a ledger
    by effect reads. A `base` of None stands for "absent": it comes back as None when nothing enters.
    """
    for effect, own in s.effects:
        act = getattr(effect, slot.name, None)
        if act is None:
            continue
        value = act(s, own)
        s.notes.contributions.setdefault(slot.name, {}).setdefault(effect.id, []).append(value)
        if base is None:
            base = value
        else:
            base = base + value if slot.rule is Rule.ADD else base * value
    return base
