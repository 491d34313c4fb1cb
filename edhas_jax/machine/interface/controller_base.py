"""Base class of controllers: one class with parameters, states and control law."""

from typing import Any, dataclass_transform

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.machine.interface.signals import Signals


class ControllerError(ValueError):
    """A controller is not declared correctly or cannot act on its machine."""


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
class Controller:
    """A controller of the piston: from set point and measured motion to the voltage command for the amplifier.

    A subclass declares parameters with `par` and defines `command(self, y, s)`; one with states also defines `initial`
    and `rates`. `y` holds its states by name, `s` the signals and parameters of the machine: `s.reference` [m],
    `s.reference_velocity` [m/s], `s.piston_position` [m], `s.piston_velocity` [m/s], and `s.current` [A] with a voltage
    amplifier. `rates` may also use `s.unlimited_voltage` [V], the result of `command`, and `s.voltage` [V], the command
    within the supply. Use `jax.numpy`, and `jnp.where` for decisions that depend on values. `docs/controllers.md` has
    an example.

    Raises:
        ControllerError: at class creation, for a class derived from another controller, without `command`, or with
            `initial` but without `rates`.
    """

    def __init_subclass__(cls):
        if cls.__bases__ != (Controller,):
            raise ControllerError(f"{cls.__name__}: derive from Controller alone and reuse code by calling it")
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
        """The voltage command [V] before the supply limit, from the own states `y` and the signals `s`, SI."""
        raise NotImplementedError

    def rates(self, y: dict[str, Any], s: Signals) -> dict[str, Any]:
        """The rate of every state of `y` from the signals `s`, SI unit of the state per second; none by default."""
        return {}
