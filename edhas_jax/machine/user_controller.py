"""Controllers of the user: load a class from a file or a module, and check it before a run."""

import inspect
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import runtime, structs
from edhas_jax.core.source_location import is_users_code, locate, reraise_interrupt
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.components.controller_sampling import Continuous, Sampled
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.loading import load_user_class
from edhas_jax.machine.effects.validation import check_derivatives, check_number, check_parameters, code_reason
from edhas_jax.machine.interface.controller_base import Controller, ControllerError
from edhas_jax.machine.interface.signals import UnknownNameError
from edhas_jax.machine.rigs import Rig

METHODS = {"initial": "(self)", "command": "(self, y, s)", "rates": "(self, y, s)"}


def load_controller(
    spec: str, base_dir: Path | str = ".", trust: Trust = ()
) -> type[Controller]:
    """Load a controller class.

    Args:
        spec: "my_controllers.py:LeadLag" or "package.module:LeadLag".
        base_dir: folder from which a relative file is looked up.
        trust: files and modules that may run, besides those that were allowed by `edhas trust`.

    Returns:
        The class; an unchanged file gives the same class again, and is not run again.

    Raises:
        ControllerError: code that was not allowed to run, a missing file or class, an error in the file, or an
            incorrect declaration.
    """
    source, colon, name = (part.strip() for part in spec.rpartition(":"))
    if not colon:
        raise ControllerError(f"{name} names no class; write {name}:ClassName")
    try:
        cls = load_user_class(source, name, Path(base_dir), Controller, TrustedCode.of(trust))
        check_parameters(cls)
    except EffectError as error:
        raise ControllerError(str(error)) from error
    for p in structs.parameters(cls):
        try:
            to_si("1" if p.unit == "-" else f"1 {p.unit}", p.unit)
        except UnitError:
            raise ControllerError(f'{locate(cls, p.name)}: is declared in "{p.unit}", which is not a unit') from None
    for method, signature in METHODS.items():
        try:
            inspect.signature(getattr(cls, method)).bind(*[None] * (signature.count(",") + 1))
        except TypeError:
            raise ControllerError(f"{locate(cls, method)}: define it as `def {method}{signature}`") from None
    return cls


def check_controller(machine: Rig, precision: str = "float64") -> None:
    """Check that the controller of a machine can act on it; the equations are traced, and nothing is computed.

    Args:
        machine: the machine.
        precision: floating-point type of the run.

    Raises:
        ControllerError: states or returned values are not what `Controller` requires, or its code fails (class.method,
            file, line, reason).
    """
    dtype = np.dtype(precision)
    names = _state_names(machine)
    trial = structs.replace(machine, sampling=Continuous())
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, dtype), trial)
    try:
        runtime.eval_shape(lambda m, zero: _dry_run(m, zero, names), numbers, dtype.type(0.0))
        check_derivatives(trial)
    except (ControllerError, EffectError) as error:
        raise ControllerError(str(error)) from error


def _state_names(machine: Rig) -> list[str]:
    """The names of the controller's states, checked."""
    cls, where = type(machine.controller), locate(type(machine.controller), "initial")
    try:
        states = machine.controller.initial()
    except BaseException as error:  # also what ends a program, such as sys.exit
        reraise_interrupt(error)
        raise ControllerError(f"{locate(cls, 'initial', error)}: {code_reason(error)}") from error
    if not isinstance(states, dict):
        raise ControllerError(f'{where}: returns no dict; return {{"name of a state": value at the start}}')
    taken = structs.replace(machine, controller=_NoCommand(), sampling=Sampled()).initial_state()
    for name, value in states.items():
        if not isinstance(name, str) or not name.isidentifier():
            raise ControllerError(f"{where}: a state is named by letters, digits and underscores, not {name!r}")
        if name in taken:
            raise ControllerError(f"{where}: the name `{name}` is taken by a state of {machine.name}")
        if not isinstance(value, int | float | np.number) or not math.isfinite(value):
            raise ControllerError(f"{where}: {name} starts at {value}; a finite number belongs here")
    return list(states)


class _NoCommand(Controller):
    """A controller without states that commands 0 V."""

    def command(self, y, s):
        return jnp.zeros_like(s.piston_position)


def _dry_run(machine: Rig, zero, names: list[str]):
    """Evaluate the equations once, with the results of the controller's methods checked."""
    for method in ("command", "rates"):
        # the trace works on a copy of the machine, so the replaced methods do not outlive it
        object.__setattr__(machine.controller, method, _checked(machine, method, names, zero.dtype))
    y = {name: zero + jnp.asarray(value, zero.dtype) for name, value in machine.initial_state().items()}
    return machine.evaluate(y, zero, zero, y)[1]


def _checked(machine: Rig, method: str, names: list[str], dtype: Any) -> Callable:
    """The method with its result checked; an error in the user's code becomes a `ControllerError` of one sentence."""
    cls, inner = type(machine.controller), getattr(machine.controller, method)

    def call(y, s):
        try:
            value = inner(y, s)
        except BaseException as error:
            reraise_interrupt(error)
            # with a controller of the package the machine is at fault, not a line of code
            at = locate(cls, method, error) if is_users_code(cls) else cls.__name__
            raise ControllerError(f"{at}: {_reason(error, machine, names)}") from error
        where = locate(cls, method)
        if method == "command":
            check_number(where, value, "a real number in V", dtype)
            return value
        if not isinstance(value, dict) or set(value) != set(names):
            listed = ", ".join(f"`{n}`" for n in names)
            raise ControllerError(f"{where}: return a dict with the rate of {listed or 'no state: an empty one'}")
        for name, rate in value.items():
            check_number(where, rate, f"a real number as rate of {name}", dtype)
        return value

    return call


def _reason(error: BaseException, machine: Rig, names: list[str]) -> str:
    """What is wrong in the code of a controller, and what to do instead."""
    if isinstance(error, UnknownNameError):
        if getattr(error, "name", None) == "current":
            why = "with a current amplifier it follows from the command; mount a voltage amplifier"
            return f"the signal `current` is not available: {why}"
        return f"on {machine.name}, {error}"
    if isinstance(error, KeyError):
        return f"there is no state {error}; the states: {', '.join(names) or 'none'}"
    return code_reason(error)
