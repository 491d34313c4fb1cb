"""Rigs of the user: load a class from a file or a module, and check its declarations and its equations before a run."""

import dataclasses
import math
import types
from collections import Counter
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.core import runtime, structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.source_location import is_users_code, locate
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.effects.base import EffectError
from edhas_jax.machine.effects.loading import load_user_class
from edhas_jax.machine.effects.validation import check_derivatives, check_number, check_parameters, code_reason
from edhas_jax.machine.interface.metrics import WholeRun
from edhas_jax.machine.interface.slots import SLOTS
from edhas_jax.machine.rig_base import Rig, RigError

RESERVED = ("name", "rig", "effects", "parameters", "simulation", "time", "time_step")  # keys and signals of every rig


def load_rig(spec: str, base_dir: Path | str = ".", trust: Trust = ()) -> type[Rig]:
    """Load a rig class.

    Args:
        spec: "my_rig.py:TwoTanks" or "package.module:TwoTanks".
        base_dir: folder from which a relative file is looked up.
        trust: files and modules that may run, besides those that were allowed by `edhas trust`.

    Returns:
        The class, checked; an unchanged file gives the same class again, and is not run again.

    Raises:
        RigError: code that was not allowed to run, a missing file or class, an error in the file, an incorrect
            declaration, or equations that fail.
    """
    source, colon, name = (part.strip() for part in str(spec).rpartition(":"))
    if not colon:
        raise RigError(f"{name} names no class; write {name}:ClassName")
    try:
        cls = load_user_class(source, name, Path(base_dir), Rig, TrustedCode.of(trust))
    except EffectError as error:
        raise RigError(str(error)) from error
    if not is_users_code(cls):
        raise RigError(f"{spec} is a rig of the package; write {cls.name} in its place")
    check_rig(cls)
    return cls


def check_rig(cls: type[Rig]) -> None:
    """Check declarations and equations of a rig class; the equations are traced, and nothing is computed.

    Raises:
        RigError: what is wrong, with class, file and line.
    """
    machine = cls()
    for field in dataclasses.fields(cls):
        part = getattr(machine, field.name)
        if field.name != "effects" and not dataclasses.is_dataclass(part):
            raise RigError(f"{locate(cls, field.name)}: a part is a component of the package, or a class of your own "
                           "with the decorator edhas_jax.struct; a number is declared with par")  # fmt: skip
        if field.name not in ("effects", *cls.drives):
            try:
                check_parameters(type(part))
            except EffectError as error:
                raise RigError(str(error)) from None
    _check_names(cls)
    _check_units(cls)
    _check_numbers(cls, machine)
    _check_metrics(cls, machine)
    for slot in (slot for slot in cls.slots if slot.name not in SLOTS):
        for name in (part for text in slot.over for part in text.split(":")):
            if name not in cls.signals:
                raise RigError(f"{locate(cls, slot.name)}: a curve over `{name}`, which is no signal of this rig; "
                               f"{suggest(name, cls.signals)}")  # fmt: skip
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf, float), machine)
    try:
        runtime.eval_shape(_dry_run, numbers, np.float64(0.0))
        check_derivatives(machine)
    except (RigError, EffectError) as error:
        raise RigError(str(error)) from error


def _dry_run(machine: Rig, zero):
    """Evaluate the equations once, with what they return checked."""
    cls = type(machine)
    where = locate(cls, "equations")
    y = {n: zero + jnp.asarray(value, zero.dtype) for n, value in machine.initial_state().items()}
    s, rates = machine.evaluate(y, zero, zero, y)
    values = s.values()
    unset = [n for n in cls.signals if n not in values]
    if unset:
        raise RigError(f"{where}: does not set the signal `{unset[0]}`; write s.set({unset[0]}=…)")
    try:
        for name, st in cls.states.items():
            check_number(where, rates[name], f"a real number in ({st.unit})/s as rate of {name}", zero.dtype)
        for name, about in cls.signals.items():
            check_number(where, values[name], f"a real number in {about.unit} as {name}", zero.dtype)
    except EffectError as error:
        raise RigError(str(error)) from None
    return rates


def _check_names(cls: type[Rig]) -> None:
    """No name has two meanings."""
    machine = cls()
    parts = {f.name for f in dataclasses.fields(cls)} - {"effects", *cls.drives}
    numbers = {n for n in machine.known_numbers() if "." not in n}
    groups = (*(("a signal", n) for n in cls.signals), *(("a number", n) for n in numbers),
              *(("a part", n) for n in parts), *(("a slot", slot.name) for slot in cls.slots),
              *(("a metric", n) for n in cls.metrics))  # fmt: skip
    count = Counter(name for _, name in groups)
    for what, name in groups:
        if count[name] > 1 or name in RESERVED and name != "time":
            raise RigError(f"{locate(cls, name)}: the name `{name}` ({what}) is taken; every name has one meaning")


def _check_metrics(cls: type[Rig], machine: Rig) -> None:
    """What the metrics take exists and is a number, and so are they; tried with signals that are 1."""
    for name, about in cls.metrics.items():
        found, where = [], locate(cls, name)
        for taken in about.taken:
            size = (3,) if isinstance(taken, WholeRun) else ()
            values = types.SimpleNamespace(**{n: np.ones(size) for n in cls.signals})
            try:
                with np.errstate(all="ignore"):
                    found.append(taken.of(machine, values))
            except AttributeError as error:
                lacking = getattr(error, "obj", None) is values
                reason = f"there is no signal `{error.name}`; {suggest(error.name, cls.signals)}" if lacking else error
                raise RigError(f"{where}: {reason}") from None
            except Exception as error:
                raise RigError(f"{where}: {code_reason(error)}") from error
        try:
            with np.errstate(all="ignore"):
                found.append(about.value(machine, *found))
        except Exception as error:
            raise RigError(f"{where}: {code_reason(error)}") from error
        if any(np.shape(value) != () or not np.issubdtype(np.result_type(value), np.number) for value in found):
            raise RigError(f"{where}: gives no number; what a metric takes, and the metric, are one number each")


def _check_numbers(cls: type[Rig], machine: Rig) -> None:
    """Time step, duration, drives, starts of states and sizes of slots are numbers."""
    known = machine.known_numbers()
    numbers = {n: (d.value, "constant value") for n, d in cls.drives.items()}
    numbers |= {slot.name: (slot.typical_size, "typical size") for slot in cls.slots}
    for name, st in cls.states.items():
        if isinstance(st.initial, str) and st.initial not in known:
            raise RigError(f"{locate(cls, name)}: starts at `{st.initial}`, which is no parameter of this rig")
        numbers[name] = (known[st.initial] if isinstance(st.initial, str) else st.initial), "start"
    numbers |= {n: (getattr(cls, n), "time in s") for n in ("time_step", "duration")}
    for name, (value, what) in numbers.items():
        is_number = isinstance(value, int | float | np.number) and not isinstance(value, bool) and math.isfinite(value)
        if not is_number or what == "time in s" and not value > 0.0:
            more = " above 0" if what == "time in s" else ""
            raise RigError(f"{locate(cls, name)}: {value!r}; a finite number{more} belongs here as {what}, in SI")


def _check_units(cls: type[Rig]) -> None:
    """Every declared unit is one."""
    units = {n: about.unit for n, about in (cls.signals | cls.metrics).items()}
    units |= {slot.name: slot.unit for slot in cls.slots}
    for part in (getattr(cls(), f.name) for f in dataclasses.fields(cls) if f.name not in ("effects", *cls.drives)):
        if dataclasses.is_dataclass(part):
            units |= {p.name: p.unit for p in structs.parameters(type(part))}
    for name, unit in units.items():
        try:
            to_si("1" if unit == "-" else f"1 {unit}", unit)
        except UnitError:
            raise RigError(f'{locate(cls, name)}: {name} is declared in "{unit}", which is not a unit') from None
