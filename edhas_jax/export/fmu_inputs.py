"""External inputs of an FMU: parameters that may change during a run, and set points or commands of another tool."""

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
from edhas_jax.machine.rigs import ActuatorParts, ActuatorSystem, Rig


class FmuError(ValueError):
    """A machine cannot be exported as an FMU in the requested form."""


class ExternalSource(enum.Enum):
    """A set point or command of the configuration that an external input may replace."""

    REFERENCE = "reference"  # set point of the position controller
    VOLTAGE = "voltage"  # command of the position controller
    TARGET = "target"  # set point of the cylinder
    SPOOL = "spool"  # command of the coordination to the reversing valve


External = ExternalSource | str  # a source of the rigs of the package, or a drive of a rig of one's own


class ExternalInput(NamedTuple):
    """An input of the unit: name, SI unit, meaning, value until the first one is set."""

    name: str
    unit: str
    doc: str
    start: float = 0.0


@struct
class ExternalSetPoint:
    """A set point that is extrapolated linearly from the time of its last input.

    Attributes:
        value: the set point at `input_time`.
        rate: its rate, [unit of the set point/s].
        input_time: the time of the last input [s].
    """

    value: Any
    rate: Any
    input_time: Any

    def value_and_rate(self, t):
        """Value and rate at time t [s]."""
        return self.value + self.rate * (t - self.input_time), self.rate


@struct
class ExternalCoordination:
    """The coordination of pump and reversing valve with external values of `share` or `spool`, where not None."""

    coordination: Coordination
    share: Any = None
    spool: Any = None

    def pump_share(self, error):
        """The share of the pump's amplitude, 0 … 1."""
        return self.coordination.pump_share(error) if self.share is None else self.share

    def spool_command(self, error):
        """The spool's set point, −1 … 1."""
        return self.coordination.spool_command(error) if self.spool is None else jnp.clip(self.spool, -1.0, 1.0)


def parse_inputs(machine: Rig, names: Sequence[str]) -> tuple[tuple[External, ...], tuple[str, ...]]:
    """Sort the names of requested inputs into external sources and parameters.

    Args:
        machine: the machine to export.
        names: values of `ExternalSource`, drives of a rig of one's own, or names of parameters.

    Returns:
        The external sources, and the names of the parameters that become inputs.

    Raises:
        FmuError: a name is unknown, does not exist on this rig or is given twice; two inputs exclude each other.
    """
    of_system = (ExternalSource.TARGET, ExternalSource.SPOOL)
    sources = [o for o in ExternalSource if isinstance(machine, ActuatorSystem if o in of_system else ActuatorParts)]
    valid = {name: name for name in machine.drives} | {o.value: o for o in sources}
    external, parameters = [], {}
    for name in names:
        if name in valid:
            if valid[name] not in external:
                external.append(valid[name])
            continue
        if sources and name in {o.value for o in ExternalSource}:
            raise FmuError(f"--input {name}: {machine.name} has no {name}; valid: {', '.join(valid)} and parameters")
        try:
            p, path = find_parameter(machine, name)
        except ParameterError as error:
            hint = "" if "nearest" in str(error) else f"; {suggest(name, valid)}, or a parameter"
            raise FmuError(f"--input {name}: {error}{hint}") from None
        if (path, p.name) in parameters:
            raise FmuError(f"--input {name}: given twice, also as {parameters[path, p.name]}")
        parameters[path, p.name] = name
    if ExternalSource.REFERENCE in external and ExternalSource.VOLTAGE in external:
        raise FmuError("--input voltage: replaces the controller, so that no reference is followed; give one of them")
    return tuple(external), tuple(parameters.values())


def rate_unit(unit: str) -> str:
    """The unit of the rate of a quantity."""
    return "1/s" if unit == "-" else f"({unit})/s" if "/" in unit or "*" in unit else f"{unit}/s"


def external_inputs(machine: Rig, external: Sequence[External]) -> list[ExternalInput]:
    """The inputs that `connect_inputs` needs for the external sources; a set point starts as configured."""

    def configured(name: str) -> float:
        return float(getattr(machine, name).value_and_rate(0.0)[0])

    def with_rate(name: str, rate_name: str, unit: str, doc: str, quantity: str) -> list[ExternalInput]:
        rate = f"rate of {quantity}, with which it goes on within a communication step; 0 holds it"
        return [ExternalInput(name, unit, doc, configured(name)), ExternalInput(rate_name, rate_unit(unit), rate)]

    inputs = []
    for name, about in ((n, machine.drives[n]) for n in external if n in machine.drives):
        inputs += with_rate(name, f"{name}_rate", about.unit, about.doc, name.replace("_", " "))
    is_open = isinstance(getattr(machine, "controller", None), OpenLoop)
    if ExternalSource.REFERENCE in external:
        quantity = "command" if is_open else "set point of the piston"
        inputs += with_rate("reference", "reference_velocity", "V" if is_open else "m", quantity, f"the {quantity}")
    if ExternalSource.VOLTAGE in external:
        doc = "command of an external controller, limited by the supply"
        inputs.append(ExternalInput("voltage_command", "V", doc, configured("reference") if is_open else 0.0))
    if ExternalSource.TARGET in external:
        inputs.append(ExternalInput("target", "m", "set point of the cylinder", configured("target")))
    if ExternalSource.SPOOL in external:
        inputs.append(ExternalInput("spool_command", "-", "set point of the reversing valve, -1 … 1"))
    return inputs


def connect_inputs(
    machine: Rig, external: Sequence[External], values: Mapping[str, Any], input_time: Any
) -> Rig:
    """Replace set points and controllers of a machine by external inputs.

    A pump whose reference or voltage is external is driven by it alone: its share of the stroke is 1.

    Args:
        machine: the machine of the configuration.
        external: the sources that are replaced.
        values: the inputs by the names of `external_inputs`, in SI.
        input_time: the time at which they were set [s].

    Returns:
        The machine with its inputs.
    """
    zero = 0.0 * input_time
    for n in (n for n in external if n in machine.drives):
        drive = ExternalSetPoint(value=values[n], rate=values[f"{n}_rate"], input_time=input_time)
        machine = structs.replace(machine, **{n: drive})
    if ExternalSource.REFERENCE in external:
        set_point = ExternalSetPoint(
            value=values["reference"], rate=values["reference_velocity"], input_time=input_time
        )
        machine = structs.replace(machine, reference=set_point)
    if ExternalSource.VOLTAGE in external:
        command = ExternalSetPoint(value=values["voltage_command"], rate=zero, input_time=input_time)
        machine = structs.replace(machine, reference=command, controller=OpenLoop(), sampling=Continuous())
    if ExternalSource.TARGET in external:
        target = ExternalSetPoint(value=values["target"], rate=zero, input_time=input_time)
        machine = structs.replace(machine, target=target)
    if isinstance(machine, ActuatorSystem):
        driven = ExternalSource.REFERENCE in external or ExternalSource.VOLTAGE in external
        coordination = ExternalCoordination(
            coordination=machine.coordination, share=1.0 if driven else None, spool=values.get("spool_command")
        )
        machine = structs.replace(machine, coordination=coordination)
    return machine


def replaced_signals(external: Sequence[External]) -> set[str]:
    """The signals that equal an input or have no meaning with it, and so are no outputs of the unit."""
    if own := {name for name in external if isinstance(name, str)}:
        return own
    reference = {ExternalSource.REFERENCE, ExternalSource.VOLTAGE} & set(external)
    signals = {"reference", "reference_velocity"} if reference else set()
    return signals | ({"target"} if ExternalSource.TARGET in external else set())
