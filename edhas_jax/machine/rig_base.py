"""The base class of every rig: a class whose body is the machine.

It declares its parts, numbers, states, drives, signals and slots as attributes and its equations as one method; so do
the three rigs of the package (`edhas_jax.machine.rigs`).
"""

import dataclasses
import types
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, ClassVar, NamedTuple, dataclass_transform

import jax

from edhas_jax.core import structs
from edhas_jax.core.source_location import is_users_code, locate, reraise_interrupt
from edhas_jax.core.structs import par
from edhas_jax.core.units import display_unit
from edhas_jax.machine.components.set_points import Sine, Step
from edhas_jax.machine.effects.base import (
    Effect,
    EffectError,
    EffectState,
    bind_states,
    effect_rates,
    initial_effect_states,
)
from edhas_jax.machine.effects.validation import code_reason
from edhas_jax.machine.interface.metrics import Metric, metrics_of_signals
from edhas_jax.machine.interface.signals import SIGNALS, Signal, Signals, UnknownNameError
from edhas_jax.machine.interface.slots import Slot

State = dict[str, Any]


class RigError(ValueError):
    """A rig is not declared correctly, or its equations fail."""


class Drive(NamedTuple):
    """What drives a machine from outside: SI unit, meaning, constant value where a configuration names no other."""

    unit: str
    doc: str
    value: float = 0.0


def drive(unit: str, doc: str, value: float = 0.0) -> Any:
    """Declare an input of a rig: recorded, a sine, a step or a chirp, as a configuration says.

    The equations read its value as `s.name` and its rate as `s.name_rate`, so that a motion can be imposed.

    Args:
        unit: SI unit.
        doc: meaning.
        value: constant value where a configuration names no other, SI.

    Returns:
        The declaration, to be assigned to a class attribute.
    """
    return Drive(unit, doc, value)


def signal(unit: str, doc: str, shown: str = "") -> Any:
    """Declare a signal that the equations set with `s.set(name=value)`.

    Args:
        unit: SI unit.
        doc: meaning.
        shown: unit in which it is shown; the usual one by default.

    Returns:
        The declaration, to be assigned to a class attribute.
    """
    return Signal(unit, shown or display_unit(unit) or "-", doc)


@dataclass_transform(frozen_default=True, kw_only_default=True, eq_default=False, field_specifiers=(par,))
class Rig:
    """A machine on a test bench: its parts, states, signals and equations.

    A subclass declares, as attributes of the class:

    - parts, `pump: Pump = Pump()`: components of the package, or own ones with the decorator `edhas_jax.struct`;
    - numbers of its own, `gain = par(0.05, "1/s", (0.0, 1.0), "gain of the pump")`;
    - states, `level = state("m", "level of the tank", "start_level")`, whose start is a number or names a parameter;
    - drives, `voltage = drive("V", "voltage of the pump")`, which a configuration replaces by a record or a sine;
    - signals, `flow = signal("m^3/s", "flow out of the tank")`, which the equations set;
    - slots for effects, `inflow = slot("tank", "m/s", "added to the rate of the level")`;
    - metrics besides mean, rms, smallest, largest and last value of every signal, see `edhas_jax.metric`.

    and defines `equations(self, y, s)`, which sets signals and returns the rate of every state by name. `y` has the
    states as attributes; `s` has the parameters, drives and states by name. Use `jax.numpy`, and `jnp.where` for
    decisions that depend on values. `docs/own_machine.md` describes one step by step.

    Attributes:
        name: name in snake case.
        states: declarations of its states.
        drives: declarations of its drives.
        signals: every signal with unit and meaning.
        slots: where effects can act.
        metrics: every metric that its runs, batches and derivatives can have.
        panels: what the figure of a run shows, each panel a title and its signals of one unit; empty: every signal.
        time_step: the time step with which a run begins [s]; it is halved until it is small enough. The largest step
            is five times as long.
        duration: usual length of a run [s].
        usual_effects: effects that a machine of a campaign has unless the campaign leaves them out.
        explaining: signals over which the error of a model is looked at, the most usual first; empty: every signal.
        fastest: what moves too fast for a step above the largest, as the end of a message.
        check_interval: sample interval of the model's runs with which records are checked [s]; 0: that of the record.
        runs_whole: whether its designs are compared by whole runs where no sine drives it.

    Raises:
        RigError: at class creation, for a rig derived from another one, without equations, or with a name twice.
    """

    name: ClassVar[str] = ""
    states: ClassVar[dict[str, EffectState]] = {}
    drives: ClassVar[dict[str, Drive]] = {}
    signals: ClassVar[Mapping[str, Signal]] = {}
    slots: ClassVar[tuple[Slot, ...]] = ()
    metrics: ClassVar[Mapping[str, Metric]] = {}
    panels: ClassVar[tuple[tuple[str, tuple[str, ...]], ...]] = ()
    time_step: ClassVar[float] = 20e-6
    duration: ClassVar[float] = 0.5
    usual_effects: ClassVar[tuple[type[Effect], ...]] = ()
    explaining: ClassVar[tuple[str, ...]] = ()
    fastest: ClassVar[str] = ""
    check_interval: ClassVar[float] = 0.0
    runs_whole: ClassVar[bool] = True

    def __init_subclass__(cls):
        parts = [base for base in cls.__bases__ if base is not Rig]
        if any(issubclass(base, Rig) or not dataclasses.is_dataclass(base) for base in parts):
            raise RigError(f"{cls.__name__}: derive from Rig alone and reuse code by calling it")
        cls.name = vars(cls).get("name") or structs.snake_case(cls.__name__)
        _declare(cls)
        structs.struct(cls)

    def __getattr__(self, name: str) -> Any:
        """A number that the rig itself declares."""
        own = self.__dict__.get(type(self).name)
        if own is None or name.startswith("__") or not hasattr(own, name):
            raise AttributeError(f"{type(self).__name__} has no part or number `{name}`")
        return getattr(own, name)

    def equations(self, y: types.SimpleNamespace, s: Signals) -> dict[str, Any]:
        """The rate of every state by name, its SI unit per second.

        Args:
            y: the states by name, SI.
            s: the parameters, drives and states by name, SI; signals that are measured are set here.
        """
        raise NotImplementedError

    def initial_state(self) -> State:
        """The state at the start of a run."""
        known = self.known_numbers()
        own = {n: known[st.initial] if isinstance(st.initial, str) else st.initial for n, st in self.states.items()}
        return own | initial_effect_states(self.effects)

    def evaluate(
        self, y: State, t, h, y_start: State, orifice_linearisation: Callable | None = None
    ) -> tuple[Signals, State]:
        """Evaluate the equations: every signal and the rate of every state at one instant.

        Args:
            y: state by name, SI.
            t: time [s].
            h: time step [s] that is being taken.
            y_start: state at the start of the step, which standstill friction needs.
            orifice_linearisation: function (name, flow, area, drop) -> flow by which a step replaces the derivatives
                of orifice flows; None leaves the tangents.

        Returns:
            The signals, and the rates by state name; the rate of an oil node is that of its strain pressure [Pa/s].

        Raises:
            RigError: the equations fail; the message says where in the user's file, and why.
        """
        known = self.known_numbers() | {"time": t, "time_step": h} | {n: y[n] for n in self.states}
        for name in self.drives:
            known[name], known[f"{name}_rate"] = getattr(self, name).value_and_rate(t)
        declared = [n for n in self.signals if n not in known]
        s = Signals(known, bind_states(self.effects, y), None, orifice_linearisation, declared, y_start)
        try:
            rates = self.equations(types.SimpleNamespace(**y), s)
        except BaseException as error:  # also what ends a program, such as sys.exit
            if isinstance(error, RigError | EffectError) or not is_users_code(type(self)):
                raise
            reraise_interrupt(error)
            raise RigError(f"{locate(type(self), 'equations', error)}: {self._reason(error)}") from error
        given = rates if isinstance(rates, dict) else {}
        missing, beyond = [n for n in self.states if n not in given], [n for n in given if n not in y]
        if missing or beyond or given is not rates:
            words = f"a rate of {', '.join(beyond)}, which is no state" if beyond else "no dict"
            words = f"no rate of {', '.join(missing)}" if missing else words
            where = locate(type(self), "equations")
            raise RigError(f"{where}: gives {words}; return a dict with the rate of every state")
        return s, rates | effect_rates(s)

    def _reason(self, error: BaseException) -> str:
        """What is wrong in the equations, and what to do instead."""
        if isinstance(error, UnknownNameError):
            return str(error)
        if isinstance(error, AttributeError) and isinstance(getattr(error, "obj", None), types.SimpleNamespace):
            return f"`y` has no state `{error.name}`; the states: {', '.join(self.states) or 'none'}"
        return code_reason(error)

    def known_numbers(self) -> dict[str, Any]:
        """The parameters of the parts by name, and all of them as `part.name`; a name of two parts only so."""
        parts = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        rows = [(part, p.name, getattr(value, p.name)) for part, value in parts.items() if part not in
                ("effects", *self.drives) for p in structs.parameters(type(value))]  # fmt: skip
        count = Counter(name for _, name, _ in rows)
        known = {f"{part}.{name}": value for part, name, value in rows}
        return known | {name: value for _, name, value in rows if count[name] == 1}

    def advance(self, y: State, k: State, t, h) -> State:
        """The state after a step of `h` [s] from the state `y` at time `t` [s] that changes it by `k`."""
        return {n: y[n] + k[n] for n in y}

    def replaceable_parts(self) -> tuple[Any, ...]:
        """What may be code of the user: the rig itself, and its effects."""
        return (self, *self.effects)

    @property
    def cycle(self) -> Sine | None:
        """The sine by which the machine is driven in a periodic state; None for any other drive."""
        return None

    def drive_unit(self, name: str) -> str:
        """SI unit of the drive of this name."""
        return self.drives[name].unit

    def with_default_numbers(self) -> "Rig":
        """A machine of the same kind with all parameters at their defaults, without effects."""
        return type(self)()

    def largest_step(self) -> float:
        """The largest time step [s]."""
        return 5.0 * self.time_step


class KindOfMachine:
    """The parts of a machine without its numbers and effects; equal for machines of one kind, so that it keys a cache.

    Attributes:
        machine: a machine of this kind, its numbers at their defaults.
    """

    def __init__(self, machine: Rig):
        self.machine = machine.with_default_numbers()
        self._structure = jax.tree.structure(self.machine)

    def __eq__(self, other) -> bool:
        return isinstance(other, KindOfMachine) and self._structure == other._structure

    def __hash__(self) -> int:
        return hash(self._structure)


def _declare(cls: type[Rig]) -> None:
    """Turn the declarations in the body of a rig into fields, states, signals and slots."""
    own = dict(vars(cls))
    if "equations" not in own:
        raise RigError(f"{cls.__name__} has no method `equations`; define `def equations(self, y, s)`")
    cls.states = {n: v for n, v in own.items() if isinstance(v, EffectState)}
    cls.drives = {n: v for n, v in own.items() if isinstance(v, Drive)}
    declared = {n: v for n, v in own.items() if isinstance(v, Signal)}
    named = {n: v._replace(name=n) for n, v in own.items() if isinstance(v, Slot)}
    cls.slots = (*own.get("slots", ()), *named.values())
    fields = dict(own.get("__annotations__", {}))
    for name, value in named.items():
        setattr(cls, name, value)
    for name, value in cls.drives.items():
        setattr(cls, name, Step(step_size=value.value))
        fields[name] = Any
    numbers = {n: v for n, v in own.items() if isinstance(v, dataclasses.Field) and "par" in v.metadata}
    if numbers:
        for name in numbers:
            delattr(cls, name)
            fields.pop(name, None)
        body = numbers | {"__annotations__": dict.fromkeys(numbers, float), "__module__": cls.__module__,
                          "__doc__": f"The numbers of {cls.__name__} itself."}  # fmt: skip
        holder = structs.struct(type(cls.__name__, (), body))
        setattr(cls, cls.name, holder())
        fields = {cls.name: holder} | fields
    cls.effects, fields["effects"] = (), tuple[Effect, ...]
    cls.__annotations__ = fields
    if cls.signals is Rig.signals:
        cls.signals = _signals(cls, declared)
    if "metrics" in own:
        return
    cls.metrics, of_its_own = metrics_of_signals(cls.signals), {n: v for n, v in own.items() if isinstance(v, Metric)}
    if twice := sorted(cls.metrics.keys() & of_its_own.keys()):
        raise RigError(f"{cls.__name__}: every signal has the metric `{twice[0]}` already; name yours otherwise")
    cls.metrics |= of_its_own


def _signals(cls: type[Rig], declared: dict[str, Signal]) -> dict[str, Signal]:
    """Every signal of a rig: time, drives with their rates, states, and those that the equations set."""
    found = {"time": SIGNALS["time"]}
    rows = [(n, Signal(d.unit, display_unit(d.unit) or "-", d.doc)) for n, d in cls.drives.items()]
    rows += [(n, Signal(st.unit, display_unit(st.unit) or "-", st.doc)) for n, st in cls.states.items()]
    for name, about in (*rows, *declared.items()):
        if name in found:
            raise RigError(f"{cls.__name__}: `{name}` is declared twice")
        found[name] = about
    return found
