"""What a controller is: one small class with its parameters, its states and its law in one place."""

from typing import Any, dataclass_transform

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.machine.interface.signals import Signals


class ControllerError(ValueError):
    """A controller is wrong in itself or cannot act on the machine it was given to."""


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
class Controller:
    """A controller of the piston: from set point and measured motion to the voltage that the amplifier is asked for.

    A subclass declares parameters with `par` and defines `command(self, y, s)`; one with states also defines `initial`
    and `rates`. `y` holds its states by name, `s` the signals and parameters of the machine: `s.reference` [m],
    `s.reference_velocity` [m/s], `s.piston_position`, `s.piston_velocity`, and `s.current` [A] with a voltage
    amplifier. In `rates` there are besides `s.unlimited_voltage`, what `command` gave, and `s.voltage`, what the supply
    left of it. Write with `jax.numpy`; a value decides by `jnp.where`. `docs/controllers.md` has an example.

    Raises:
        ControllerError: at class creation, for a class derived from another controller, without `command`, or with
            `initial` but without `rates`.
    """

    def __init_subclass__(cls):
        if cls.__bases__ != (Controller,):
            raise ControllerError(f"{cls.__name__}: derive from Controller alone and call what you need")
        own = vars(cls)
        if "command" not in own:
            raise ControllerError(f"{cls.__name__} has no method `command`; define `def command(self, y, s)`")
        if ("initial" in own) != ("rates" in own):
            what = "`initial` but no `rates`" if "initial" in own else "`rates` but no `initial`"
            raise ControllerError(f"{cls.__name__} has {what}; a state needs its start and its rate")
        structs.struct(cls)

    def initial(self) -> dict[str, Any]:
        """The states at the start of a run, in SI; none by default."""
        return {}

    def command(self, y: dict[str, Any], s: Signals):
        """The voltage [V] that is asked for, before the limit of the supply."""
        raise NotImplementedError

    def rates(self, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """The rate of every state; none by default."""
        return {}
