"""Where the energy and the oil go: a ledger kept step by step beside the run."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from edhas_jax.circuit import firmness
from edhas_jax.system import Rig, State

FLOWS = (
    "suction_flow_a", "suction_flow_b", "delivery_flow_a", "delivery_flow_b", "leakage_a", "leakage_b",
    "outlet_flow", "return_flow", "relief_flow", "accumulator_flow",
)  # fmt: skip
GROUPS = ("input", "copper", "mechanical", "fluid", "stored", "delivered")


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


def post(machine: Rig, book: Book, before: State, after: State, k: State, t, h) -> Book:
    """Add what one step moved.

    Efforts and flows are those that the step itself used, value + ½ ∂·k at mid-step, so that each balance of the step
    holds row by row; what is stored is taken from the states at both ends instead. The ledger closes only as far as
    the step conserves energy and oil: it is a check of the numerics, not a rearrangement of them.
    """

    firm = firmness(machine, machine.evaluate(before, t + 0.5 * h, h, before)[0])

    def ports(y):
        s, _ = machine.evaluate(y, t + 0.5 * h, h, before, firm)
        values = s.values()
        bonds = {n: (b.effort, b.flow) for n, b in s.notes.bonds.items()}
        nodes = {n: (node.pressure, node.volume) for n, node in s.notes.nodes.items()}
        return _arrays((bonds, nodes, {n: values[n] for n in FLOWS if n in values}), h)

    def ends(y, time):
        s, _ = machine.evaluate(y, time, h, y)
        pressures = {n: node.pressure for n, node in s.notes.nodes.items()}
        extra = {n: node.extra_capacity for n, node in s.notes.nodes.items() if node.extra_capacity is not None}
        return s, _arrays((s.notes.stores, pressures, extra), h)

    value, slope = jax.jvp(ports, (before,), (k,))
    bonds, nodes, flows = jax.tree.map(lambda a, da: a + 0.5 * da, value, slope)
    s0, (stores0, p0, extra) = ends(before, t)
    _, (stores1, p1, _) = ends(after, t + h)

    energy = {n: h * effort * flow for n, (effort, flow) in bonds.items()}
    energy |= {n: stores1[n] - stores0[n] for n in stores0}
    volume = {n: h * q for n, q in flows.items()}
    for n, (pressure, space) in nodes.items():
        taken_up = space * machine.oil.strain(p0[n], p1[n], s0)
        if n in extra:
            taken_up = taken_up + extra[n] * (p1[n] - p0[n])
        energy[f"oil, {n}"] = pressure * taken_up
        volume[f"oil, {n}"] = taken_up
    if "accumulator gas" in book.volume:
        volume["accumulator gas"] = after["gas_volume_change"] - before["gas_volume_change"]
    return Book(
        {n: total + energy[n] for n, total in book.energy.items()},
        {n: total + volume[n] for n, total in book.volume.items()},
    )


def _arrays(tree, h):
    return jax.tree.map(lambda v: jnp.asarray(v, jnp.result_type(h)), tree)
