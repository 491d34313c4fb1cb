"""A law: an effect of the truth, the mechanism of the library that it is a law of, and what sets its size."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from typing import Any

from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter, par
from edhas_jax.machine.effects import CoilHeating, CouplingCompliance, Effect, EffectError, MagneticSaturation, state
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.rig_base import KindOfMachine
from edhas_jax.machine.rigs import Rig

# laws of the library whose effect falls with their first parameter
FALLING = (MagneticSaturation, CoilHeating, CouplingCompliance)
# a second coupling or line in such a slot would have no physical meaning
SPAN = 1e3  # limits of a parameter over its plausible range


@dataclasses.dataclass(frozen=True)
class Law:
    """One law of a mechanism.

    Args:
        mechanism: the effect of the library that an engineer would name; None where the library has none.
        kind: the effect that acts; the mechanism itself for the law of the library.
        falling: whether it becomes smaller as its first parameter grows; known for those of the library.
    """

    mechanism: type[Effect] | None
    kind: type[Effect]
    falling: bool = False

    @property
    def id(self) -> str:
        """The id of the effect that acts."""
        return self.kind.id

    @property
    def name(self) -> str:
        """The name that a right answer has; that of the law where the library has no such mechanism."""
        return self.kind.id if self.mechanism is None else self.mechanism.id

    @property
    def free_parameters(self) -> list[Parameter]:
        """The parameters that differ from case to case."""
        return [p for p in structs.parameters(self.kind) if p.plausible is not None]

    @property
    def size(self) -> Parameter:
        """The parameter that sets the size: the first one."""
        return self.free_parameters[0]

    @property
    def falls(self) -> bool:
        """Whether the effect becomes smaller as that parameter grows."""
        return self.falling or self.kind in FALLING

    @property
    def locations(self) -> tuple[str, ...]:
        """The components of the machine on which it acts, sorted."""
        return tuple(sorted({slot.location for slot in self.kind.slots}))


def library_law(mechanism: type[Effect]) -> Law:
    """The law of the library itself."""
    return Law(mechanism, mechanism)


def law(
    mechanism: type[Effect] | None, name: str, text: str, values: Mapping[str, tuple[str, float, float]], *,
    states: Mapping[str, str] | None = None, confused_with: tuple[str, ...] = (), falling: bool = False,
    rig: type[Rig] | None = None, **terms: Callable,
) -> Law:  # fmt: skip
    """A law from its formulas.

    Args:
        mechanism: the effect of the library that it is a law of; None where the library has none.
        name: name of the class of the effect.
        text: what acts, and "Source: " with where it is from.
        values: SI unit and plausible range of each parameter, that of the size first.
        states: SI unit of each state.
        confused_with: ids of effects of the library with a similar influence, where there is no mechanism.
        falling: see `Law`.
        rig: the rig of one's own at whose slots it acts; None for those of the package.
        terms: what it contributes at each of its slots, and `rates`: functions of effect, signals and states.
    """
    body: dict[str, Any] = {n: _parameter(n, *of) for n, of in values.items()}
    annotations = dict.fromkeys(body, float)
    body |= {n: state(unit, n.replace("_", " ")) for n, unit in (states or {}).items()} | terms
    body |= {"__annotations__": annotations, "__doc__": text, "__module__": __name__, "confused_with": confused_with}
    return Law(mechanism, type(name, (Effect,), body, **({} if rig is None else {"rig": rig})), falling)


def _parameter(name: str, unit: str, low: float, high: float) -> Any:
    middle = (low * high) ** 0.5 if low > 0.0 else 0.6 * high
    span = (low / SPAN, high * SPAN) if low > 0.0 else (-SPAN * high, SPAN * high)
    return par(middle, unit, span, name.replace("_", " "), plausible=(low, high))


def can_mount(machine: Rig, kind: type[Effect]) -> bool:
    """Whether a machine has the slots of an effect, free where they hold one effect only, and the signals it reads."""
    slots = {slot.name for slot in kind.slots}
    taken = {slot.name for effect in machine.effects for slot in effect.slots if slot.is_exclusive}
    if slots & taken or not slots <= {slot.name for slot in machine.slots}:
        return False
    return kind.id not in {effect.id for effect in machine.effects} and _can_act(KindOfMachine(machine), kind)


@functools.cache
def _can_act(of: KindOfMachine, kind: type[Effect]) -> bool:
    """Whether a machine has what an effect reads; tried on one with default parameters, whose equations are traced."""
    try:
        check_effect(kind(), of.machine)
    except EffectError:
        return False
    return True
