"""Checks of an effect: its declaration, and that it acts on a machine without an error.

`check_parameters`, `check_number` and `code_reason` also serve the checks of controllers.
"""

import dataclasses
import difflib
import inspect
import math
import types
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.derivative_graph import defer_partials, linearize
from edhas_jax.compiler.sparse_elimination import jacobian
from edhas_jax.core import runtime, structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.source_location import display_path, first_line, is_users_code, locate, reraise_interrupt
from edhas_jax.machine.effects.base import Effect, EffectError
from edhas_jax.machine.interface.controller_base import Controller
from edhas_jax.machine.interface.signals import SIGNALS, UnknownNameError
from edhas_jax.machine.interface.slots import SLOTS

_PRECISION_HINT = (
    "a constant forces another precision on the run; write numbers as float(np.sqrt(2.0)), "
    "tables as jnp.asarray(table, s.current.dtype)"
)


def check_declaration(cls: type[Effect]) -> None:
    """Check id, parameters and method signatures of an effect class.

    Raises:
        EffectError: what is wrong, with class, file and line.
    """
    if not cls.id.isidentifier():
        raise EffectError(f"{locate(cls)}: the id `{cls.id}` is not a name of letters, digits and underscores")
    check_parameters(cls)
    for method in _methods(cls):
        try:
            inspect.signature(getattr(cls, method)).bind(None, None, None)
        except TypeError:
            raise EffectError(f"{locate(cls, method)}: define it as `def {method}(self, s, z)`") from None


def check_parameters(cls: type) -> None:
    """Check that every field of a class of the user is a correctly declared parameter.

    Raises:
        EffectError: what is wrong, with class, file and line.
    """
    for field in dataclasses.fields(cls):
        if not field.metadata.get("static") and (problem := _parameter_problem(field)):
            raise EffectError(f"{locate(cls, field.name)}: {problem}")
    by_name = {p.name: p for p in structs.parameters(cls)}
    for p in by_name.values():
        if p.at_least and (p.at_least not in by_name or p.default < by_name[p.at_least].default):
            raise EffectError(
                f"{locate(cls, p.name)}: at_least must name another parameter of {cls.__name__}, "
                "with a default that is not larger"
            )


def check_effect(effect: Effect, machine: Any, precision: str = "float64") -> None:
    """Check that an effect can act on a machine; the equations are traced, and nothing is computed.

    Args:
        effect: the effect, mounted on the machine or not.
        machine: the machine.
        precision: floating-point type of the run.

    Raises:
        EffectError: the machine has none of its slots, its id is taken, or its code fails (class.method, file, line,
            reason).
    """
    cls = type(effect)
    check_declaration(cls)
    others = tuple(e for e in machine.effects if e is not effect)
    if any(e.id == effect.id for e in others):
        raise EffectError(f"{effect.id} is given twice; every effect of a machine needs its own id")
    if effect.id in {f.name for f in dataclasses.fields(machine)}:
        raise EffectError(f"{locate(cls)}: the id `{effect.id}` is taken by a part of {machine.name}")
    available = {slot.name for slot in machine.slots}
    if not any(slot.name in available for slot in effect.slots):
        places = " and ".join(dict.fromkeys(f"the {slot.location.replace('_', ' ')}" for slot in effect.slots))
        names = ", ".join(slot.name for slot in effect.slots)
        word = "slot" if len(effect.slots) == 1 else "slots"
        raise EffectError(f"{effect.id} acts on {places} ({word} {names}), which {machine.name} does not have")
    trial = dataclasses.replace(machine, effects=(*others, effect))
    try:
        dtype = np.dtype(precision)
        runtime.eval_shape(_dry_run, jax.tree.map(lambda leaf: np.asarray(leaf, dtype), trial), dtype.type(0.0))
        check_derivatives(trial)
    except EffectError:
        raise
    except Exception as error:
        raise EffectError(f"{locate(cls)}: {type(error).__name__}: {first_line(error)}") from error


def check_derivatives(machine: Any) -> None:
    """Check that what the user's code gives has finite derivatives by the states at rest, as a time step needs them.

    Args:
        machine: the machine as it is configured; the package's own equations are not checked.

    Raises:
        EffectError: where, of what and with respect to which state a derivative is not finite.
    """
    users = [part for part in machine.replaceable_parts() if is_users_code(type(part))]
    if not users:
        return
    places, h = {}, machine.time_step

    def values(y):
        s, rates = machine.evaluate(y, 0.5 * h, h, start, defer_partials)
        terms = [term for part in users for term in _terms_of(part, s, rates)]
        places.update({name: where for name, where, _ in terms})
        return {name: value for name, _, value in terms}

    def everything(y):
        s, rates = machine.evaluate(y, 0.5 * h, h, y)
        return {n: v for n, v in s.values().items() if hasattr(v, "dtype")} | rates

    with runtime.double_precision():
        machine = jax.tree.map(jnp.asarray, machine)  # samples of a recorded drive are taken at a traced time
        start = {n: jnp.asarray(value, float) for n, value in machine.initial_state().items()}
        _check_callbacks(jax.make_jaxpr(everything)(start).jaxpr)
        slopes = jacobian(linearize(values, start))
    for name, where in places.items():
        for state, slope in slopes[name].items():
            if not math.isfinite(slope):
                raise EffectError(f"{where}: the derivative of {name} with respect to {state} at rest is not "
                                  "finite (√|x| has an infinite slope at 0); use a law with a finite slope there, such "
                                  "as x/(x² + ε²)^¼ for √|x|")  # fmt: skip


def _check_callbacks(jaxpr) -> None:
    """Nothing in a traced function calls Python while it runs, as `jax.debug.print` and `jax.pure_callback` do.

    Raises:
        EffectError: what does, with the line from which it is called.
    """
    for eqn in jaxpr.eqns:
        if "callback" in eqn.primitive.name or eqn.primitive.name == "debug_print":
            frames = eqn.source_info.traceback.frames
            library = str(Path(jax.__file__).parent)
            at = next(f for f in frames if not f.file_name.startswith(library))
            raise EffectError(f"{display_path(Path(at.file_name))}:{at.line_num}: {eqn.primitive.name} calls Python in "
                              "every time step, which machine code cannot; write it with jax.numpy")  # fmt: skip
        for value in jax.tree.leaves(list(eqn.params.values())):
            if hasattr(inner := getattr(value, "jaxpr", value), "eqns"):
                _check_callbacks(inner)


def _terms_of(part: Any, s: Any, rates: dict[str, Any]) -> Iterator[tuple[str, str, Any]]:
    """What a part of the user gives to the equations: name for a message, location, value."""
    cls, states, method = type(part), (), "rates"
    if isinstance(part, Effect):
        for slot in cls.slots:
            if part.id in s.record.contributions.get(slot.name, {}):
                yield slot.name, locate(cls, slot.name), s.effect_contributions(slot.name)[part.id]
        states = [f"{part.id}.{name}" for name in cls.states]
    elif isinstance(part, Controller):
        yield "the command", locate(cls, "command"), s.voltage
        states = part.initial()
    else:
        states, method = part.states, "equations"
    for name in states:
        yield f"the rate of {name}", locate(cls, method), rates[name]


def _dry_run(machine, zero):
    """Evaluate the equations once, with the results of the last effect's methods checked."""
    tested = machine.effects[-1]
    for method in _methods(type(tested)):
        # the trace works on a copy of the effect, so the replaced methods do not outlive it
        object.__setattr__(tested, method, _checked(tested, method, machine, zero.dtype))
    y = {name: zero + jnp.asarray(value, zero.dtype) for name, value in machine.initial_state().items()}
    s, rates = machine.evaluate(y, zero, zero, y)
    if not any(tested.id in found for found in s.record.contributions.values()):
        names = ", ".join(slot.name for slot in tested.slots)
        raise EffectError(f"{tested.id} has no influence: this {machine.name} does not evaluate {names}")
    return rates


def _checked(effect: Effect, method: str, machine: Any, dtype: Any) -> Callable:
    """The method with its result checked; an error in the user's code becomes an `EffectError` of one sentence."""
    cls, inner = type(effect), getattr(effect, method)
    unit = next((slot.unit for slot in cls.slots if slot.name == method), "")

    def call(s, z):
        try:
            value = inner(s, z)
        except EffectError:
            raise
        except BaseException as error:  # also what ends a program, such as sys.exit
            reraise_interrupt(error)
            raise EffectError(f"{locate(cls, method, error)}: {_reason(error, cls, machine)}") from error
        where = locate(cls, method)
        if method != "rates":
            check_number(where, value, f"a real number in {unit}" if unit != "-" else "a real factor", dtype)
            return value
        if not isinstance(value, dict):
            raise EffectError(f"{where}: returns {_type_text(value)}, not a dict of the rates of {_listed(cls.states)}")
        for name in value:
            if name not in cls.states:
                raise EffectError(f"{where}: gives a rate of `{name}`, which is no state; {_state_hint(name, cls)}")
        missing = [name for name in cls.states if name not in value]
        if missing:
            raise EffectError(f"{where}: gives no rate of {_listed(missing)}")
        for name, rate in value.items():
            check_number(where, rate, f"a real number in ({cls.states[name].unit})/s as rate of {name}", dtype)
        return value

    return call


def check_number(where: str, value: Any, expected: str, dtype: Any) -> None:
    """Check that a method of the user returned one real number in the precision `dtype`.

    Raises:
        EffectError: what it returned instead of `expected`.
    """
    if value is None:
        raise EffectError(f"{where}: returns nothing; return {expected}")
    if not isinstance(value, float) and not hasattr(value, "dtype"):
        raise EffectError(f"{where}: returns {_type_text(value)}; return {expected}")
    if jnp.shape(value) != ():
        raise EffectError(f"{where}: returns an array of shape {jnp.shape(value)}; return {expected}, one at a time")
    if not jnp.issubdtype(jnp.result_type(value), jnp.floating):
        raise EffectError(f"{where}: returns a value of type {jnp.result_type(value)}; return {expected}")
    is_bare = type(value) is float or getattr(value, "weak_type", False)
    if not is_bare and jnp.result_type(value) != dtype:
        raise EffectError(f"{where}: {_PRECISION_HINT}")


def _reason(error: BaseException, cls: type[Effect], machine: Any) -> str:
    """What is wrong in the code of an effect, and what to do instead."""
    if isinstance(error, UnknownNameError):
        name, known = getattr(error, "name", None), getattr(getattr(error, "obj", None), "_values", None)
        if name is None or known is None:
            return f"on {machine.name}, {first_line(error)}"
        return f"{machine.name} has no signal or parameter `{name}` at this slot; {_instead(name, known, machine)}"
    if isinstance(error, AttributeError) and isinstance(getattr(error, "obj", None), types.SimpleNamespace):
        return f"`z` has no state `{error.name}`; {_state_hint(error.name, cls)}"
    return code_reason(error)


def code_reason(error: BaseException) -> str:
    """What is wrong in code that JAX cannot trace, and what to do instead."""
    if isinstance(error, jax.errors.TracerBoolConversionError):
        return "a value decides by `if`, `and`, `or`, `not`, `min` or `max`; decide with jnp.where"
    if isinstance(error, jax.errors.TracerArrayConversionError):
        return "a function of numpy meets a value of the run; take the one of jax.numpy"
    if isinstance(error, jax.errors.ConcretizationTypeError):
        return "a value of the run is turned into a Python number (float, int, math); stay with jax.numpy"
    if type(error).__name__ == "TypePromotionError":
        return _PRECISION_HINT
    return f"{type(error).__name__}: {first_line(error)}".rstrip(": ")


def _instead(name: str, known, machine: Any) -> str:
    """At which slots an unknown signal exists, or which similar names exist."""
    slots = [slot.name for slot in machine.slots if name in slot.local_signals]
    if slots:
        return f"it is known at {', '.join(slots)}"
    if name in SIGNALS or any(name in slot.local_signals for slot in SLOTS.values()):
        return "it belongs to another rig, or is computed only after this slot"
    close = difflib.get_close_matches(name, known, n=3, cutoff=0.5)
    return f"nearest: {', '.join(close)}" if close else "edhas_jax/machine/interface/signals.py lists the signals"


def _parameter_problem(field: dataclasses.Field) -> str:
    """What is wrong in the declaration of one parameter, and what is allowed; empty where nothing is."""
    if "par" not in field.metadata:
        return 'declare a parameter with par(default, "unit", (low, high), "meaning")'
    try:
        unit, (low, high), doc, _ = field.metadata["par"]
        low, high, default = float(low), float(high), float(field.default)
    except (TypeError, ValueError):
        return 'declare it as par(default, "unit", (low, high), "meaning")'
    if not isinstance(unit, str) or not isinstance(doc, str):
        return "unit and meaning of a parameter must be texts"
    if not (low <= default <= high and math.isfinite(default)):
        return f"the default {default:g} is outside its own span {low:g} … {high:g}"
    if (plausible := field.metadata["plausible"]) is not None:
        inside = isinstance(plausible, tuple) and len(plausible) == 2 and low <= plausible[0] < plausible[1] <= high
        if not inside or not plausible[0] <= default <= plausible[1]:
            return "plausible must be (low, high) within the span, with the default inside"
    return ""


def _methods(cls: type[Effect]) -> list[str]:
    """The methods of an effect that the equations call."""
    return [slot.name for slot in cls.slots] + ["rates"] * bool(cls.states or "rates" in vars(cls))


def _type_text(value: Any) -> str:
    """The type of a value with an article, for a message."""
    if value is None:
        return "nothing"
    name = "number" if isinstance(value, jax.Array) else type(value).__name__
    return f"an {name}" if name[0] in "aeiou" else f"a {name}"


def _state_hint(name: str, cls: type[Effect]) -> str:
    """The states that may have been meant, for a message."""
    return suggest(name, cls.states) if cls.states else f"{cls.__name__} declares no states"


def _listed(names) -> str:
    """Names in backticks, separated by commas."""
    return ", ".join(f"`{n}`" for n in names) or "no states"
