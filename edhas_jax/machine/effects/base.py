"""Base class of effects: one class with parameters, states and the terms it adds to the equations."""

import types
from typing import Any, ClassVar, NamedTuple, dataclass_transform

from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import par
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import SLOTS, Slot


class EffectError(ValueError):
    """An effect is not declared correctly or cannot act on its machine."""


class EffectState(NamedTuple):
    """A state of an effect: SI unit, meaning, value at the start of a run."""

    unit: str
    doc: str
    initial: float = 0.0


def state(unit: str, doc: str, initial: float = 0.0) -> Any:
    """Declare a state of an effect; the effect gives its rate in `rates`.

    Args:
        unit: SI unit as text.
        doc: meaning.
        initial: value at the start of a run, SI.

    Returns:
        The declaration, to be assigned to a class attribute.
    """
    return EffectState(unit, doc, initial)


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
class Effect:
    """One physical effect: the terms it adds to the equations at its slots.

    A subclass declares parameters with `par` and states with `state`, and defines one method per slot, with the slot's
    name from `edhas_jax.machine.interface.slots`: `method(self, s, z)`, where `s` holds the signals and parameters of
    the machine and `z` the effect's own states. It returns the contribution in the slot's unit. An effect with states
    also defines `rates(self, s, z)`, which returns a dict {state: d state/dt}. An effect that acts at slots of a rig of
    one's own names the rig in its class statement: `class Overflow(Effect, rig=TwoTanks)`.

    The step linearises all contributions, so a stiff effect is integrated implicitly without further code. Use
    `jax.numpy`, and `jnp.where` instead of `if` for decisions that depend on values.

    Attributes:
        id: name in snake case.
        states: states by name.
        slots: the slots at which the effect acts.
        looks_like: what the effect does to measurements, in one sentence.
        confused_with: ids of effects and names of parameters whose influence is similar.
        memory_of: the signal on whose past the contribution to the first slot depends linearly; empty for other laws.
        varies_with: the signal with which a constant contribution to the first slot would vary, if it did; empty where
            none is more likely than the others, and for other laws.

    Raises:
        EffectError: at class creation, for a class derived from an effect, a public method that is no slot, a slot
            that is not a plain method, or a state without a rate.
    """

    id: ClassVar[str]
    states: ClassVar[dict[str, EffectState]]
    slots: ClassVar[tuple[Slot, ...]]
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[tuple[str, ...]] = ()
    memory_of: ClassVar[str] = ""
    varies_with: ClassVar[str] = ""

    def __init_subclass__(cls, rig: Any = None):
        known = SLOTS if rig is None else {slot.name: slot for slot in rig.slots}
        for other in (base for base in cls.__bases__ if base is not Effect):
            rule = "an effect is final; derive from Effect" if issubclass(other, Effect) else "derive from Effect alone"
            raise EffectError(f"{cls.__name__} derives from {other.__name__}: {rule} and reuse code by calling it")
        cls.id = structs.owner_id(cls)
        cls.states = {n: v for n, v in vars(cls).items() if isinstance(v, EffectState)}
        public = {n: v for n, v in vars(cls).items() if not n.startswith("_")}
        for name, value in public.items():
            if name in known or name == "rates":
                if not isinstance(value, types.FunctionType):
                    raise EffectError(f"{cls.__name__}.{name}: define it as `def {name}(self, s, z)`")
            elif callable(value) or isinstance(value, classmethod):
                raise EffectError(f"{cls.__name__}.{name} is no slot; {suggest(name, known)}")
        cls.slots = tuple(known[n] for n in public if n in known)
        if not cls.slots:
            raise EffectError(f"{cls.__name__} enters no slot; valid: {', '.join(known)}")
        if cls.states and "rates" not in public:
            raise EffectError(f"{cls.__name__} has states ({', '.join(cls.states)}) but no method `rates`")
        structs.struct(cls)

    def rates(self, s: Signals, z: types.SimpleNamespace) -> dict[str, Any]:
        """The rates of the effect's own states `z` by name, from the signals `s`, SI; none by default."""
        return {}


def bind_states(effects: tuple[Effect, ...], y: dict[str, Any]) -> tuple[tuple[Effect, types.SimpleNamespace], ...]:
    """Each effect with its own states, which the machine's state `y` holds under the names `effect.state`."""
    return tuple((e, types.SimpleNamespace(**{n: y[f"{e.id}.{n}"] for n in e.states})) for e in effects)


def initial_effect_states(effects: tuple[Effect, ...]) -> dict[str, float]:
    """The states of all effects at the start of a run."""
    return {f"{e.id}.{n}": st.initial for e in effects for n, st in e.states.items()}


def effect_rates(s: Signals) -> dict[str, Any]:
    """The rates of the states of all effects, named `effect.state`."""
    return {f"{e.id}.{n}": rate for e, z in s.effects for n, rate in e.rates(s, z).items()}
