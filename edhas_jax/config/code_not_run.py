"""What stands for the user's code in a result that is opened without running it."""

from collections.abc import Callable
from typing import Any, NoReturn

from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.interface.controller_base import Controller, ControllerError


def effect_not_run(spec: str) -> Effect:
    """An effect with the name of the user's; evaluating it raises an EffectError that says what to do."""

    def mover_force(self, s, z) -> NoReturn:
        raise EffectError(_sentence(spec))

    return _stand_in(spec, Effect, mover_force)


def controller_not_run(spec: str) -> Controller:
    """A controller with the name of the user's; evaluating it raises a ControllerError that says what to do."""

    def command(self, y, s) -> NoReturn:
        raise ControllerError(_sentence(spec))

    return _stand_in(spec, Controller, command)


def require_code(machine) -> None:
    """Refuse a machine whose code was not run: it has lost the parameters of that code.

    Raises:
        EffectError: what to do instead.
    """
    for part in machine.replaceable_parts():
        spec = getattr(type(part), "_spec_not_run", None)
        if spec is not None:
            raise EffectError(_sentence(spec))


def _stand_in(spec: str, base: type, method: Callable) -> Any:
    name, about = spec.rpartition(":")[2].strip(), {"__doc__": f"Of {spec}, which was not run.", "_spec_not_run": spec}
    own = {"__module__": __name__, method.__name__: method} | about
    return type(name if name.isidentifier() else "NotRun", (base,), own)()


def _sentence(spec: str) -> str:
    return (f"the machine of this result needs {spec}, which is not run when a result is opened; to have the machine, "
            f"open the result with trust=[\"{spec.rpartition(':')[0]}\"], or run its configuration again")  # fmt: skip
