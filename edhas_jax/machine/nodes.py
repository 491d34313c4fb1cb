"""Nodes at which the parts of a rig of one's own connect: oil sums flows, a moving body sums forces.

Equations written with them read like a circuit diagram: make the nodes, connect the parts, ask for the rates. Each
connection takes from one node what it gives to the other, so that no oil is lost, and the power that is lost in it is a
row of the energy balance.
"""

from typing import Any

import jax.numpy as jnp

from edhas_jax.machine.components.accumulator import Accumulator
from edhas_jax.machine.components.oil import Oil
from edhas_jax.machine.equations.orifice_flow import orifice_flow
from edhas_jax.machine.interface.signals import Signals


class Node:
    """A point of a hydraulic circuit: a pressure, and the sum of what flows in.

    Attributes:
        s: the signals.
        name: signal of its pressure.
        pressure: absolute [Pa].
        inflow: sum of the flows into it so far [m³/s].
    """

    def __init__(self, s: Signals, name: str, pressure):
        self.s, self.name, self.pressure = s, name, pressure
        self.inflow = jnp.zeros_like(pressure)
        s.define(**{name: pressure})

    def add(self, flow) -> None:
        """Let oil into the node, not from another one: what a piston displaces that moves into its volume.

        Args:
            flow: [m³/s], positive into the node.
        """
        self.inflow = self.inflow + flow

    def flow_to(self, other: "Node", flow, row: str, group: str = "fluid") -> Any:
        """Let oil flow to another node: what leaves this one enters the other.

        Args:
            other: the node that it reaches.
            flow: [m³/s], positive from this node to the other.
            row: name of the row of the energy balance that counts the power lost on the way; "" for none.
            group: group of this row: "fluid" for a loss, "delivered" for the flow through a load.

        Returns:
            The flow.
        """
        self.add(-flow)
        other.add(flow)
        if row:
            self.s.record_power(row, group, self.pressure - other.pressure, flow)
        return flow

    def orifice_to(self, other: "Node", machine: Any, area, row: str, group: str = "fluid") -> Any:
        """Let oil flow through an orifice to another node, in either direction.

        The rig needs the parts `oil` and `orifice`. A time step linearises the root of the pressure drop so that it
        does not oscillate where the drop changes sign.

        Args:
            other: the node at the other end.
            machine: the rig.
            area: of the orifice [m²].
            row: name of the row of the energy balance, different for every orifice.
            group: as for `flow_to`.

        Returns:
            The flow [m³/s], positive from this node to the other.
        """
        return self.flow_to(other, orifice_flow(machine, self.s, row, area, (self.name, other.name)), row, group)


class OilNode(Node):
    """A volume of oil; its pressure is a state of the rig: volume/β dp/dt = inflow.

    Args:
        s: the signals.
        name: the state.
        oil: the oil.
        volume: [m³]; where it changes, `add` what the moving wall displaces.
        capacity: what else yields to pressure, such as a hose, volume per pressure [m³/Pa]; None for nothing.
    """

    def __init__(self, s: Signals, name: str, oil: Oil, volume, capacity=None):
        super().__init__(s, name, getattr(s, name))
        self._oil, self._volume, self._capacity = oil, volume, capacity

    def rates(self) -> dict[str, Any]:
        """The rate of the state; after all connections."""
        return self._oil.rate(self.name, self.inflow, self._volume, self.s, self._capacity)


class Reservoir(Node):
    """A tank whose pressure stays as it is, however much flows in or out; arguments as of `Node`."""

    def rates(self) -> dict[str, Any]:
        """No rate; after all connections the energy that the tank takes up is counted."""
        self.s.record_power(self.name.removesuffix("_pressure"), "stored", self.pressure, self.inflow)
        return {}


class GasNode(Node):
    """A gas-charged accumulator; the change of its gas volume [m³] is a state of the rig.

    Oil that flows in compresses the gas: d(change)/dt = −inflow, and the pressure follows from the volume.

    Args:
        s: the signals.
        name: name under which its pressure is a signal.
        state: name of the state, which starts at 0.
        accumulator: pressure and volume of the gas at rest, and its polytropic exponent.
    """

    def __init__(self, s: Signals, name: str, state: str, accumulator: Accumulator):
        super().__init__(s, name, accumulator.pressure(getattr(s, state)))
        self._state = state

    def rates(self) -> dict[str, Any]:
        """The rate of the state; after all connections."""
        self.s.record_power(f"{self.name.removesuffix('_pressure')}: compression", "stored", self.pressure, self.inflow)
        return {self._state: -self.inflow}


class Body:
    """A mass or a shaft; its speed is a state of the rig: inertia · d(speed)/dt = sum of forces or torques.

    Args:
        s: the signals.
        name: the state: speed [m/s] or [rad/s].
        inertia: mass [kg] or moment of inertia [kg·m²].
    """

    def __init__(self, s: Signals, name: str, inertia):
        self.s, self.name, self.speed, self._inertia = s, name, getattr(s, name), inertia
        self.force = jnp.zeros_like(self.speed)
        s.record_stored_energy(f"{name}: motion", 0.5 * inertia * jnp.square(self.speed))

    def add(self, force, row: str = "", group: str = "mechanical") -> None:
        """A force [N] or torque [N·m] along the speed.

        Args:
            force: positive where it accelerates.
            row: name of the row of the energy balance that counts its power; "" where another row does already, as
                for the pressure of oil that flows.
            group: of this row: "input" for a drive, "delivered" for a load, "mechanical" for a loss.
        """
        self.force = self.force + force
        if row:
            self.s.record_power(row, group, force if group == "input" else -force, self.speed)

    def rates(self) -> dict[str, Any]:
        """The rate of the state; after all forces."""
        return {self.name: self.force / self._inertia}



