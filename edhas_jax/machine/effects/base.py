"""What an effect is: one small class with its parameters, its states and its equation in one place."""

import types
from typing import Any, ClassVar, NamedTuple, dataclass_transform

from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import par
from edhas_jax.machine.interface.signals import Signals
from edhas_jax.machine.interface.slots import SLOTS, Slot


class EffectError(ValueError):
    """An effect is wrong in itself or cannot act on the machine it was given to."""


class EffectState(NamedTuple):
    """A state that an effect brings along: SI unit, meaning, value at the start of a run."""

    unit: str
    doc: str
    initial: float = 0.0


def state(unit: str, doc: str, initial: float = 0.0) -> Any:
    """Declare a state of an effect; the effect gives its rate in `rates`."""
    return EffectState(unit, doc, initial)


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
class Effect:
    """One physical effect: what it adds to the base equations, at the slots it names.

    A subclass declares parameters with `par` and states with `state`, and defines one method per slot it enters, named
    as the slot in `edhas_jax.machine.interface.slots`: `method(self, s, z)` with `s` the signals (and parameters) of
    the machine and `z` the effect's own states. It returns the contribution in the slot's unit. An effect with states
    also defines `rates(self, s, z)`, which returns a dict {state: d state/dt}. `looks_like` says in one sentence what
    the effect does to measurements; `confused_with` has the ids of effects and the names of parameters that do nearly
    the same.

    The step linearises whatever an effect returns, so a stiff effect is implicit without another line. Physics must be
    written with `jax.numpy`; a value decides by `jnp.where`, not by `if`.

    Raises:
        EffectError: at class creation, for a class derived from an effect, a public method that is no slot, something
            else than a plain method under the name of a slot, or a state without a rate.
    """

    id: ClassVar[str]
    states: ClassVar[dict[str, EffectState]]
    slots: ClassVar[tuple[Slot, ...]]
    looks_like: ClassVar[str] = ""
    confused_with: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls):
        for other in (base for base in cls.__bases__ if base is not Effect):
            rule = "an effect is final; derive from Effect" if issubclass(other, Effect) else "derive from Effect alone"
            raise EffectError(f"{cls.__name__} derives from {other.__name__}: {rule} and call what you need")
        cls.id = structs.owner_id(cls)
        cls.states = {n: v for n, v in vars(cls).items() if isinstance(v, EffectState)}
        public = {n: v for n, v in vars(cls).items() if not n.startswith("_")}
        for name, value in public.items():
            if name in SLOTS or name == "rates":
                if not isinstance(value, types.FunctionType):
                    raise EffectError(f"{cls.__name__}.{name}: define it as `def {name}(self, s, z)`")
            elif callable(value) or isinstance(value, classmethod):
                raise EffectError(f"{cls.__name__}.{name} is no slot; {suggest(name, SLOTS)}")
        cls.slots = tuple(SLOTS[n] for n in public if n in SLOTS)
        if not cls.slots:
            raise EffectError(f"{cls.__name__} enters no slot; valid: {', '.join(SLOTS)}")
        if cls.states and "rates" not in public:
            raise EffectError(f"{cls.__name__} has states ({', '.join(cls.states)}) but no method `rates`")
        structs.struct(cls)

    def rates(self, s: Signals, z: types.SimpleNamespace) -> dict[str, Any]:
        """The rates of the effect's own states; none by default."""
        return {}


def bind_states(effects: tuple[Effect, ...], y: dict[str, Any]) -> tuple[tuple[Effect, types.SimpleNamespace], ...]:
    """Each effect with its own states, taken from the machine's state `y` (named `effect.state` there)."""
    return tuple((e, types.SimpleNamespace(**{n: y[f"{e.id}.{n}"] for n in e.states})) for e in effects)


def initial_effect_states(effects: tuple[Effect, ...]) -> dict[str, float]:
    """The states of all effects at the start of a run."""
    return {f"{e.id}.{n}": st.initial for e in effects for n, st in e.states.items()}


def effect_rates(s: Signals) -> dict[str, Any]:
    """The rates of the states of all effects that act in `s`."""
    return {f"{e.id}.{n}": rate for e, z in s.effects for n, rate in e.rates(s, z).items()}
