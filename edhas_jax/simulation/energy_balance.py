"""Where the energy and the oil go: a ledger kept step by step beside the run."""

from typing import Any, NamedTuple

import jax.numpy as jnp

from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.rigs import Rig, State

FLOWS = (
    "suction_flow_a", "suction_flow_b", "delivery_flow_a", "delivery_flow_b", "leakage_a", "leakage_b",
    "outlet_flow", "return_flow", "relief_flow", "accumulator_flow",
)  # fmt: skip


class Book(NamedTuple):
    """Energies [J] and volumes [m³] cumulated since the start, by row."""

    energy: dict[str, Any]
    volume: dict[str, Any]


def rows(machine: Rig) -> dict[str, str]:
    """The rows of the energy ledger of a machine and the group each belongs to."""
    y = machine.start()
    notes = machine.evaluate(y, 0.0, 1.0, y)[0].notes
    groups = {name: bond.group for name, bond in notes.bonds.items()}
    return groups | {name: "stored" for name in notes.stores} | {f"oil, {name}": "stored" for name in notes.nodes}


def opening(machine: Rig, y: State, h) -> Book:
    """An empty book with the rows of this machine."""
    zero = jnp.zeros((), jnp.result_type(h))
    s, _ = machine.evaluate(y, zero, h, y)
    volumes = [n for n in FLOWS if n in s.values()] + [f"oil, {n}" for n in s.notes.nodes]
    if "gas_volume_change" in y:
        volumes.append("accumulator gas")
    return Book({n: zero for n in rows(machine)}, {n: zero for n in volumes})


def ports(s: Signals) -> dict[str, Any]:
    """What the ledger wants to see at mid-step: both sides of each bond, pressure and volume of each node, flows."""
    values = s.values()
    seen = {n: values[n] for n in FLOWS if n in values}
    for n, bond in s.notes.bonds.items():
        seen |= {f"effort {n}": bond.effort, f"flow {n}": bond.flow}
    for n, node in s.notes.nodes.items():
        seen |= {f"pressure {n}": node.pressure, f"volume {n}": node.volume}
    return seen


def post(machine: Rig, book: Book, before: State, after: State, middle: dict[str, Any], t, h) -> Book:
    """Add what one step moved; `middle` are the `ports` as the step saw them.

    Each balance of the step then holds row by row, while what is stored is taken from the states at both ends. The
    ledger closes only as far as the step conserves energy and oil: it checks the numerics, it does not rearrange them.
    """

    def ends(y, time):
        s, _ = machine.evaluate(y, time, h, y)
        pressures = {n: node.pressure for n, node in s.notes.nodes.items()}
        extra = {n: node.extra_capacity for n, node in s.notes.nodes.items() if node.extra_capacity is not None}
        return s, (s.notes.stores, pressures, extra)

    s0, (stores0, p0, extra) = ends(before, t)
    _, (stores1, p1, _) = ends(after, t + h)
    energy = {n: h * middle[f"effort {n}"] * middle[f"flow {n}"] for n in s0.notes.bonds}
    energy |= {n: stores1[n] - stores0[n] for n in stores0}
    volume = {n: h * middle[n] for n in FLOWS if n in middle}
    for n in p0:
        taken_up = middle[f"volume {n}"] * machine.oil.strain(p0[n], p1[n], s0)
        if n in extra:
            taken_up = taken_up + extra[n] * (p1[n] - p0[n])
        energy[f"oil, {n}"] = middle[f"pressure {n}"] * taken_up
        volume[f"oil, {n}"] = taken_up
    if "accumulator gas" in book.volume:
        volume["accumulator gas"] = after["gas_volume_change"] - before["gas_volume_change"]
    return Book(
        {n: total + energy[n] for n, total in book.energy.items()},
        {n: total + volume[n] for n, total in book.volume.items()},
    )
