"""The names of everything the machine can be asked for: one list, shared by model, measurements and effects."""

from collections.abc import Callable
from typing import Any, NamedTuple

from edhas_jax.core.names import nearest


class Signal(NamedTuple):
    """A quantity of the running machine: SI unit, the unit it is shown in, and its meaning."""

    unit: str
    shown: str
    doc: str


SIGNALS: dict[str, Signal] = {
    "time": Signal("s", "s", "time from the start of the run"),
    "reference": Signal("m", "mm", "set point of the piston"),
    "reference_velocity": Signal("m/s", "m/s", "rate of the set point"),
    "voltage": Signal("V", "V", "command of the controller, within the supply"),
    "coil_voltage": Signal("V", "V", "voltage at the terminals of the coil"),
    "current": Signal("A", "A", "coil current"),
    "motor_force": Signal("N", "N", "electromagnetic force on the mover"),
    "piston_position": Signal("m", "mm", "mover and plungers, from mid-stroke, positive into chamber A"),
    "piston_velocity": Signal("m/s", "m/s", "speed of the mover"),
    "coupling_deflection": Signal("m", "mm", "how far the plungers lag behind the coil carrier"),
    "friction_force": Signal("N", "N", "friction on the mover, viscous damping apart"),
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
    "cylinder_velocity": Signal("m/s", "m/s", "speed of the cylinder"),
    "cylinder_friction": Signal("N", "N", "friction of the cylinder, viscous damping apart"),
}


HIGHEST_PRESSURE = 1e9


class UnknownName(AttributeError):
    """A signal or parameter was asked for that this machine does not have."""


class Bond(NamedTuple):
    """A power port: where energy goes is effort × flow [W]."""

    group: str
    effort: Any
    flow: Any


class Node(NamedTuple):
    """A volume of oil that stores energy: pressure [Pa], volume [m³], further capacity [m³/Pa] or None."""

    pressure: Any
    volume: Any
    extra_capacity: Any


class Passage(NamedTuple):
    """An orifice between two nodes of oil: its pressure drop [Pa], its area [m²] and the names of the nodes."""

    drop: Any
    area: Any
    ends: tuple[str, str]


class Notes(NamedTuple):
    """What the equations write down beside the signals.

    Contributions by slot and effect; power bonds; energy stored [J]; nodes of oil and the poles of their strain
    pressure and the rates of their pressures [Pa/s], all by the signal of the pressure; orifices between them; signals
    that must stay in a range.
    """

    contributions: dict[str, dict[str, list]]
    bonds: dict[str, Bond]
    stores: dict[str, Any]
    nodes: dict[str, Node]
    poles: dict[str, Any]
    pressure_rates: dict[str, Any]
    passages: dict[str, Passage]
    limits: dict[str, tuple]


class Signals:
    """The signals of one instant while the equations are written down; read as attributes.

    Parameters of the machine are read the same way (`s.piston_diameter`), so that no effect keeps a copy of a
    value that is not its own. `at(...)` gives a local view, as a valve or a chamber sees the machine.
    """

    def __init__(self, values: dict[str, Any], effects=(), notes: Notes | None = None, law: Callable | None = None):
        self._values = values
        self.effects = effects
        self.law = law
        self.notes = Notes({}, {}, {}, {}, {}, {}, {}, {}) if notes is None else notes

    def __getattr__(self, name: str):
        try:
            return self.__dict__["_values"][name]
        except KeyError:
            raise UnknownName(f"no signal or parameter `{name}` here; {nearest(name, self._values)}") from None

    def set(self, **values) -> None:
        """Add signals that are now known."""
        self._values.update(values)

    def at(self, **local) -> "Signals":
        """A local view: the same signals with some added."""
        return Signals({**self._values, **local}, self.effects, self.notes, self.law)

    def bond(self, name: str, group: str, effort, flow) -> None:
        """Note that `effort` × `flow` is the power that goes to `name`."""
        self.notes.bonds[name] = Bond(group, effort, flow)

    def store(self, name: str, energy) -> None:
        """Note that `energy` [J] is stored in `name`."""
        self.notes.stores[name] = energy

    def node(self, name: str, pressure, volume, extra_capacity=None) -> None:
        """Note a volume of oil; its pressure must stay positive and below what any term of the model is made for."""
        self.notes.nodes[name] = Node(pressure, volume, extra_capacity)
        self.limit(name, 0.0, HIGHEST_PRESSURE)

    def limit(self, name: str, low, high) -> None:
        """Note that the signal `name` is physical only from `low` to `high` (SI)."""
        self.notes.limits[name] = (low, high)

    def entered(self, slot_name: str) -> dict[str, Any]:
        """What each effect has entered at a slot so far, by the effect's id."""
        return {e: sum(v[1:], start=v[0]) for e, v in self.notes.contributions.get(slot_name, {}).items()}

    def bond_entered(self, slot_name: str, group: str, flow, sign: float = 1.0) -> None:
        """Note the power sign · contribution · `flow` of each effect at a slot, in a row of the effect's own.

        An effect that takes power at two places has a row for each: `effect` and `effect, slot`.
        """
        for effect, value in self.entered(slot_name).items():
            row = effect if effect not in self.notes.bonds else f"{effect}, {slot_name}"
            self.bond(row, group, value if sign > 0 else -value, flow)

    def values(self) -> dict[str, Any]:
        """Every signal by name."""
        return dict(self._values)
