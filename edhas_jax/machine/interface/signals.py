"""The named signals of the machine, and the object in which the equations collect them at one instant.

`SIGNALS` is the one list of signal names that the model, measurements and effects share. `Signals` holds the values
while the equations are evaluated, and an `EquationRecord` of further quantities for the step and the balances: power
bonds, stored energies, oil nodes, orifices and valid ranges.
"""

from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import from_si


class Signal(NamedTuple):
    """The description of a signal: SI unit, unit for display and meaning."""

    unit: str
    display_unit: str
    doc: str

    def shown(self, values):
        """Values (SI) in the unit for display."""
        return from_si(values, self.unit, self.display_unit)

    def shown_difference(self, values):
        """Differences (SI) in the unit for display, whose zero may lie elsewhere."""
        return self.shown(values) - self.shown(0.0)


SIGNALS: dict[str, Signal] = {
    "time": Signal("s", "s", "time from the start of the run"),
    "reference": Signal("m", "mm", "set point of the piston"),
    "reference_velocity": Signal("m/s", "m/s", "rate of the set point"),
    "voltage": Signal("V", "V", "command of the controller, within the supply"),
    "coil_voltage": Signal("V", "V", "voltage at the terminals of the coil"),
    "current": Signal("A", "A", "coil current"),
    "motor_force": Signal("N", "N", "electromagnetic force on the mover"),
    "piston_position": Signal("m", "mm", "mover and plungers, from mid-stroke, positive into chamber A"),
    "piston_velocity": Signal("m/s", "m/s", "velocity of the mover"),
    "coupling_deflection": Signal("m", "mm", "lag of the plungers behind the coil carrier"),
    "friction_force": Signal("N", "N", "friction on the mover, without viscous damping"),
    "stop_force": Signal("N", "N", "force of the end stops on the mover"),
    "chamber_pressure_a": Signal("Pa", "MPa", "pump chamber A, absolute"),
    "chamber_pressure_b": Signal("Pa", "MPa", "pump chamber B, absolute"),
    "leakage_a": Signal("m^3/s", "L/min", "flow past plunger A to the accumulator"),
    "leakage_b": Signal("m^3/s", "L/min", "flow past plunger B to the accumulator"),
    "suction_lift_a": Signal("m", "mm", "lift of suction valve A, negative in seat contact"),
    "suction_lift_b": Signal("m", "mm", "lift of suction valve B"),
    "delivery_lift_a": Signal("m", "mm", "lift of delivery valve A"),
    "delivery_lift_b": Signal("m", "mm", "lift of delivery valve B"),
    "suction_flow_a": Signal("m^3/s", "L/min", "flow through suction valve A into the chamber"),
    "suction_flow_b": Signal("m^3/s", "L/min", "flow through suction valve B into the chamber"),
    "delivery_flow_a": Signal("m^3/s", "L/min", "flow through delivery valve A out of the chamber"),
    "delivery_flow_b": Signal("m^3/s", "L/min", "flow through delivery valve B out of the chamber"),
    "outlet_pressure": Signal("Pa", "MPa", "outlet node, absolute"),
    "outlet_flow": Signal("m^3/s", "L/min", "flow from the outlet node to the load"),
    "relief_flow": Signal("m^3/s", "L/min", "flow through the relief valve"),
    "suction_pressure": Signal("Pa", "MPa", "manifold before the suction valves, absolute"),
    "suction_line_flow": Signal("m^3/s", "L/min", "flow from the accumulator to the manifold"),
    "accumulator_pressure": Signal("Pa", "MPa", "accumulator, absolute"),
    "accumulator_flow": Signal("m^3/s", "L/min", "net flow into the accumulator"),
    "gas_volume": Signal("m^3", "mL", "gas in the accumulator"),
    "target": Signal("m", "mm", "set point of the cylinder"),
    "spool": Signal("-", "-", "opening of the reversing valve, -1 … 1"),
    "head_pressure": Signal("Pa", "MPa", "head side of the cylinder, absolute"),
    "rod_pressure": Signal("Pa", "MPa", "rod side of the cylinder, absolute"),
    "return_flow": Signal("m^3/s", "L/min", "flow that returns to the accumulator"),
    "cylinder_position": Signal("m", "mm", "position of the cylinder"),
    "cylinder_velocity": Signal("m/s", "m/s", "velocity of the cylinder"),
    "cylinder_friction": Signal("N", "N", "friction of the cylinder, without viscous damping"),
}


# of the figure of a run: title, and signals of one unit
PANELS = (
    ("piston", ("reference", "piston_position")),
    ("cylinder", ("target", "cylinder_position")),
    ("voltage", ("voltage",)),
    ("current", ("current",)),
    ("pressure", ("chamber_pressure_a", "chamber_pressure_b", "outlet_pressure", "accumulator_pressure")),
    ("pressure", ("head_pressure", "rod_pressure")),
    ("valve lift", ("suction_lift_a", "delivery_lift_a")),  # of one chamber each: suction of A hides delivery of B
    ("valve lift", ("suction_lift_b", "delivery_lift_b")),
    ("flow", ("outlet_flow",)),
    ("friction", ("friction_force",)),
)

MAX_NODE_PRESSURE = 1e9  # Pa, above which no term of the model is valid


class UnknownNameError(AttributeError):
    """No signal or parameter of this name exists on this machine, or not at this point of the equations."""


class PowerBond(NamedTuple):
    """A power term of the energy balance, `effort` × `flow` [W], in the group `group`."""

    group: str
    effort: Any
    flow: Any


class OilNode(NamedTuple):
    """A volume of oil that stores energy: pressure [Pa], volume [m³], further capacity [m³/Pa] or None."""

    pressure: Any
    volume: Any
    extra_capacity: Any


class OrificeConnection(NamedTuple):
    """An orifice between two oil nodes: pressure drop [Pa], flow area [m²] and the names of the two pressures."""

    drop: Any
    area: Any
    ends: tuple[str, str]


class EquationRecord(NamedTuple):
    """Quantities beside the signals that the equations record for the step and for the balances.

    Attributes:
        contributions: by slot and effect id, the contributions made there.
        power_bonds: by row of the energy balance.
        stored_energies: energy [J] by row of the energy balance.
        oil_nodes: by the signal of the node's pressure.
        strain_poles: pole c [Pa²] of the strain pressure p − c/p, by the signal of the node's pressure.
        pressure_rates: dp/dt [Pa/s] by the signal of the node's pressure.
        orifices: by name.
        valid_ranges: (low, high) in SI of the signals that are physical only within a range.
    """

    contributions: dict[str, dict[str, list]]
    power_bonds: dict[str, PowerBond]
    stored_energies: dict[str, Any]
    oil_nodes: dict[str, OilNode]
    strain_poles: dict[str, Any]
    pressure_rates: dict[str, Any]
    orifices: dict[str, OrificeConnection]
    valid_ranges: dict[str, tuple]


class Signals:
    """The signals of one instant while the equations are evaluated; read as attributes, values in SI.

    Parameters of the machine are read the same way (`s.piston_diameter`), so that no effect keeps a copy of a value
    that belongs to another component. `with_local(...)` gives the view of one valve or one chamber.

    Attributes:
        effects: pairs of an effect and its own states.
        record: further quantities for the step and the balances.
        orifice_linearisation: None, or a function (name, flow, area, drop) -> flow by which the step replaces the
            derivatives of an orifice flow.
        step_start: state at the start of the step, which standstill friction needs.
    """

    def __init__(
        self,
        values: dict[str, Any],
        effects: tuple = (),
        record: EquationRecord | None = None,
        orifice_linearisation: Callable | None = None,
        settable: Collection[str] | None = None,
        step_start: Mapping[str, Any] = MappingProxyType({}),
    ):
        self._values, self._settable, self.step_start = values, settable, step_start
        self.effects = effects
        self.orifice_linearisation = orifice_linearisation
        self.record = EquationRecord({}, {}, {}, {}, {}, {}, {}, {}) if record is None else record

    def __getattr__(self, name: str):
        try:
            return self.__dict__["_values"][name]
        except KeyError:
            raise UnknownNameError(f"there is no signal or parameter `{name}`; {suggest(name, self._values)}") from None

    def set(self, **values) -> None:
        """Add signals that are now known; equations of a rig of one's own set those that it declares.

        Raises:
            UnknownNameError: such a rig declares no signal of this name.
        """
        for name in values if self._settable is not None else ():
            if name not in self._settable:
                known = name in self._values
                what = "is a state, drive or number, which is not set" if known else "is not declared with `signal`"
                close = f"; {suggest(name, self._settable)}" if self._settable else ""
                raise UnknownNameError(f"s.set({name}=…): `{name}` {what}{close}")
        self.define(**values)

    def define(self, **values) -> None:
        """Add values that parts of the equations compute, declared or not."""
        self._values.update(values)

    def with_local(self, **local) -> "Signals":
        """The same signals with the local ones of a valve, a chamber or a node added; the record is shared."""
        return Signals({**self._values, **local}, self.effects, self.record, self.orifice_linearisation, self._settable,
                       self.step_start)  # fmt: skip

    def record_power(self, name: str, group: str, effort, flow) -> None:
        """Count the power `effort` × `flow` [W] in the row `name` of the energy balance."""
        self.record.power_bonds[name] = PowerBond(group, effort, flow)

    def record_stored_energy(self, name: str, energy) -> None:
        """Record that `energy` [J] is stored in `name`."""
        self.record.stored_energies[name] = energy

    def record_oil_node(self, name: str, pressure, volume, extra_capacity=None) -> None:
        """Record an oil node by the name of its pressure; the pressure must stay within 0 … `MAX_NODE_PRESSURE`.

        Args:
            name: signal of the node's pressure.
            pressure: absolute pressure [Pa].
            volume: oil volume [m³].
            extra_capacity: capacity beside that of the oil [m³/Pa], or None.
        """
        self.record.oil_nodes[name] = OilNode(pressure, volume, extra_capacity)
        self.record_valid_range(name, 0.0, MAX_NODE_PRESSURE)

    def record_valid_range(self, name: str, low, high) -> None:
        """Record that the signal `name` is physical only from `low` to `high` (SI)."""
        self.record.valid_ranges[name] = (low, high)

    def effect_contributions(self, slot_name: str) -> dict[str, Any]:
        """The sum of the contributions made at a slot so far, by effect id."""
        return {e: sum(v[1:], start=v[0]) for e, v in self.record.contributions.get(slot_name, {}).items()}

    def record_effect_power(self, slot_name: str, group: str, flow, sign: float = 1.0) -> None:
        """Record the power sign · contribution · `flow` [W] of each effect at a slot, in a row of the effect's own.

        An effect that takes power at two slots has two rows: `effect` and `effect, slot`.
        """
        for effect, value in self.effect_contributions(slot_name).items():
            row = effect if effect not in self.record.power_bonds else f"{effect}, {slot_name}"
            self.record_power(row, group, value if sign > 0 else -value, flow)

    def values(self) -> dict[str, Any]:
        """Every signal and parameter by name."""
        return dict(self._values)
