"""What an FMU takes from outside while it runs: parameters as inputs, and the set point or command of another tool."""

import enum
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp

from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import struct
from edhas_jax.machine.components.controller_sampling import Continuous
from edhas_jax.machine.components.controllers import Coordination, OpenLoop
from edhas_jax.machine.parameters import ParameterError, find_parameter
from edhas_jax.machine.rigs import ActuatorSystem, Rig


class FmuError(ValueError):
    """A machine cannot be made into an FMU as it was asked for."""


class Outside(enum.Enum):
    """What may come from outside in place of what the configuration has mounted."""

    REFERENCE = "reference"  # what the controller of the piston follows
    VOLTAGE = "voltage"  # what a controller would ask for
    TARGET = "target"  # where the cylinder goes
    SPOOL = "spool"  # what the coordination asks of the reversing valve


class Input(NamedTuple):
    """A quantity that comes from outside: SI unit, meaning."""

    name: str
    unit: str
    doc: str


@struct
class Given:
    """A set point given at the time `since` and continued along the rate given with it."""

    value: Any
    rate: Any
    since: Any

    def value_and_rate(self, t):
        """Value and rate at time t [s]."""
        return self.value + self.rate * (t - self.since), self.rate


@struct
class PartlyGiven:
    """A coordination of pump and reversing valve of which a part, where it is not None, comes from outside."""

    inner: Coordination
    share: Any = None
    spool: Any = None

    def pump_share(self, error):
        """The share of the pump's amplitude."""
        return self.inner.pump_share(error) if self.share is None else self.share

    def spool_command(self, error):
        """The spool's set point, −1 … 1."""
        return self.inner.spool_command(error) if self.spool is None else jnp.clip(self.spool, -1.0, 1.0)


def read_inputs(machine: Rig, names: Sequence[str]) -> tuple[tuple[Outside, ...], tuple[str, ...]]:
    """What comes from outside, and the names of the parameters that become inputs.

    Raises:
        FmuError: a name that is neither, that this machine lacks, that is given twice; two that exclude each other.
    """
    kinds = [o for o in Outside if isinstance(machine, ActuatorSystem) or o in (Outside.REFERENCE, Outside.VOLTAGE)]
    valid = {o.value: o for o in kinds}
    outside, parameters = [], {}
    for name in names:
        if name in valid:
            if valid[name] not in outside:
                outside.append(valid[name])
            continue
        if name in {o.value for o in Outside}:
            raise FmuError(f"--input {name}: {machine.name} has no {name}; valid: {', '.join(valid)} and parameters")
        try:
            p, path = find_parameter(machine, name)
        except ParameterError as error:
            hint = "" if "nearest" in str(error) else f"; {suggest(name, valid)}, or a parameter"
            raise FmuError(f"--input {name}: {error}{hint}") from None
        if (path, p.name) in parameters:
            raise FmuError(f"--input {name}: given twice, also as {parameters[path, p.name]}")
        parameters[path, p.name] = name
    if Outside.REFERENCE in outside and Outside.VOLTAGE in outside:
        raise FmuError("--input voltage: replaces the controller, so that no reference is followed; give one of them")
    return tuple(outside), tuple(parameters.values())


def inputs_of(machine: Rig, outside: Sequence[Outside]) -> list[Input]:
    """The inputs that `mount` needs, by name."""
    rows = []
    if Outside.REFERENCE in outside:
        unit = "V" if isinstance(machine.controller, OpenLoop) else "m"
        what = "command" if unit == "V" else "set point of the piston"
        rows.append(Input("reference", unit, what))
        rate = f"rate of the {what}; 0 holds it over a communication step"
        rows.append(Input("reference_velocity", f"{unit}/s", rate))
    if Outside.VOLTAGE in outside:
        rows.append(Input("voltage_command", "V", "command of a controller outside, limited by the supply"))
    if Outside.TARGET in outside:
        rows.append(Input("target", "m", "set point of the cylinder"))
    if Outside.SPOOL in outside:
        rows.append(Input("spool_command", "-", "set point of the reversing valve, -1 … 1"))
    return rows


def mount(machine: Rig, outside: Sequence[Outside], given: Mapping[str, Any], since: Any) -> Rig:
    """`machine` with what comes from outside in its place; `given` at the time `since`, by the names of `inputs_of`.

    A pump whose reference or voltage is given is driven by it alone: its share of the stroke is 1.
    """
    zero = 0.0 * since
    if Outside.REFERENCE in outside:
        set_point = Given(value=given["reference"], rate=given["reference_velocity"], since=since)
        machine = structs.replace(machine, reference=set_point)
    if Outside.VOLTAGE in outside:
        command = Given(value=given["voltage_command"], rate=zero, since=since)
        machine = structs.replace(machine, reference=command, controller=OpenLoop(), sampling=Continuous())
    if Outside.TARGET in outside:
        machine = structs.replace(machine, target=Given(value=given["target"], rate=zero, since=since))
    if isinstance(machine, ActuatorSystem):
        driven = Outside.REFERENCE in outside or Outside.VOLTAGE in outside
        coordination = PartlyGiven(
            inner=machine.coordination, share=1.0 if driven else None, spool=given.get("spool_command")
        )
        machine = structs.replace(machine, coordination=coordination)
    return machine


def replaced_signals(outside: Sequence[Outside]) -> set[str]:
    """The signals that say nothing beside the inputs."""
    gone = {"reference", "reference_velocity"} if {Outside.REFERENCE, Outside.VOLTAGE} & set(outside) else set()
    return gone | ({"target"} if Outside.TARGET in outside else set())
