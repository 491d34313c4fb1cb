"""Energy and volume balance of a run, cumulated step by step with the quantities that the step itself used."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.rigs import Rig, State

CUMULATED_FLOWS = (
    "suction_flow_a", "suction_flow_b", "delivery_flow_a", "delivery_flow_b", "leakage_a", "leakage_b",
    "outlet_flow", "return_flow", "relief_flow", "accumulator_flow",
)  # fmt: skip


class Balance(NamedTuple):
    """Energies [J] and volumes [m³] since the start of the run, by row."""

    energy: dict[str, Any]
    volume: dict[str, Any]


def row_groups(machine: Rig) -> dict[str, str]:
    """The rows of the energy balance of a machine, each with its group.

    Groups are "input", "copper", "mechanical", "fluid", "delivered" and "stored".
    """
    y = machine.initial_state()
    record = machine.evaluate(y, 0.0, 1.0, y)[0].record
    groups = {name: bond.group for name, bond in record.power_bonds.items()}
    stored = [*record.stored_energies, *(f"oil, {name}" for name in record.oil_nodes)]
    return groups | dict.fromkeys(stored, "stored")


def zero_balance(machine: Rig, y: State, h) -> Balance:
    """The balance at the start of a run: every row of this machine at zero, in the precision of `h`."""
    zero = jnp.zeros((), jnp.result_type(h))
    s, _ = machine.evaluate(y, zero, h, y)
    volumes = [n for n in CUMULATED_FLOWS if n in s.values()] + [f"oil, {n}" for n in s.record.oil_nodes]
    if "gas_volume_change" in y:
        volumes.append("accumulator gas")
    return Balance({n: zero for n in row_groups(machine)}, {n: zero for n in volumes})


def midpoint_quantities(s: Signals) -> dict[str, Any]:
    """What the balance needs at mid-step: flows, both factors of each power bond, pressure and volume of each node."""
    values = s.values()
    out = {n: values[n] for n in CUMULATED_FLOWS if n in values}
    for n, bond in s.record.power_bonds.items():
        out |= {f"effort {n}": bond.effort, f"flow {n}": bond.flow}
    for n, node in s.record.oil_nodes.items():
        out |= {f"pressure {n}": node.pressure, f"volume {n}": node.volume}
    return out


def add_step(
    machine: Rig, balance: Balance, before: State, after: State, at_midstep: dict[str, Any], t, h
) -> Balance:
    """Add one step to a balance.

    Power bonds are integrated with their values at mid-step; stored energy is the difference of the states at both
    ends. The balance therefore closes only as far as the step conserves energy and oil, and so checks the numerics.

    Args:
        machine: the machine.
        balance: the balance before the step.
        before: state at the start of the step.
        after: state at its end.
        at_midstep: `midpoint_quantities` as the step saw them.
        t: time at the start of the step [s].
        h: step [s].

    Returns:
        The balance after the step.
    """

    def stored(y, time):
        s, _ = machine.evaluate(y, time, h, y)
        pressures = {n: node.pressure for n, node in s.record.oil_nodes.items()}
        extra = {n: node.extra_capacity for n, node in s.record.oil_nodes.items() if node.extra_capacity is not None}
        return s, (s.record.stored_energies, pressures, extra)

    s0, (energies0, p0, extra) = stored(before, t)
    _, (energies1, p1, _) = stored(after, t + h)
    energy = {n: h * at_midstep[f"effort {n}"] * at_midstep[f"flow {n}"] for n in s0.record.power_bonds}
    energy |= {n: energies1[n] - energies0[n] for n in energies0}
    volume = {n: h * at_midstep[n] for n in CUMULATED_FLOWS if n in at_midstep}
    for n in p0:
        taken_up = at_midstep[f"volume {n}"] * machine.oil.strain(p0[n], p1[n], s0)
        if n in extra:
            taken_up = taken_up + extra[n] * (p1[n] - p0[n])
        energy[f"oil, {n}"] = at_midstep[f"pressure {n}"] * taken_up
        volume[f"oil, {n}"] = taken_up
    if "accumulator gas" in balance.volume:
        volume["accumulator gas"] = after["gas_volume_change"] - before["gas_volume_change"]
    return Balance(
        {n: total + energy[n] for n, total in balance.energy.items()},
        {n: total + volume[n] for n, total in balance.volume.items()},
    )
