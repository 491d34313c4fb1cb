"""Reads the mapping of a configuration: makes the machine and the settings of its run, or lists all problems."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.code_not_run import controller_not_run, effect_not_run
from edhas_jax.config.declared_keys import quantity
from edhas_jax.config.document import Entry, Problem
from edhas_jax.config.law_file import LAW_SUFFIXES, LawError, read_law, read_law_file
from edhas_jax.config.machine_keys import SHORT_NAMES, machine_keys
from edhas_jax.config.recorded_signal import RECORDING, RecordingError, decode_samples, read_recording
from edhas_jax.config.run_settings import SIMULATION_SETTINGS, read_settings
from edhas_jax.config.writer import config_kind
from edhas_jax.config.yaml_with_lines import KeyPath, key_text, yaml_type
from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.source_location import is_users_code
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, format_quantity, to_si, with_article
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controller_sampling import Sampled
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.cylinder import Cylinder
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.effects.tabulated_law import rig_of, table_of
from edhas_jax.machine.effects.validation import check_derivatives, check_effect
from edhas_jax.machine.interface.controller_base import Controller, ControllerError
from edhas_jax.machine.own_rig import load_rig
from edhas_jax.machine.parameters import (
    COMPONENT_KINDS,
    ParameterError,
    component_kinds,
    find_parameter,
    list_parameters,
    order_problems,
    replace_value,
)
from edhas_jax.machine.rig_base import Rig, RigError
from edhas_jax.machine.rigs import RIGS
from edhas_jax.machine.user_controller import check_controller, load_controller

SETTING_NAMES = (*SIMULATION_SETTINGS, "precision")
ORDER_CHECKED_BELOW = ("cylinder", "sampling")  # components whose order of parameters has a sentence of its own
Given = Mapping[tuple[str, str], KeyPath]  # the key of every parameter that the configuration sets, by path and name


def read_rig(entry: Entry, base_dir: Path, trust: Trust) -> type[Rig] | None:
    """The rig that the key `rig` names: one of the package, or one's own as file.py:ClassName.

    Args:
        entry: of the key; its value may be a class of the user, which needs no permission.
        base_dir: folder to which files are relative.
        trust: the user's code that may run.

    Returns:
        The class; None after a problem.
    """
    value, names = entry.value, ", ".join(RIGS)
    if isinstance(value, type) and issubclass(value, Rig):
        return value
    if value is None:
        return entry.add(f"missing; one of {names}")
    if not isinstance(value, str):
        return entry.add(f"a text belongs here, not {yaml_type(value)}; one of {names}")
    if value in RIGS:
        return RIGS[value]
    if not _names_code(value):
        return entry.add(f"no rig `{value}`; {suggest(value, RIGS)}")
    try:
        return load_rig(value, base_dir, trust)
    except RigError as error:
        return entry.add(str(error))


def _names_code(value: Any) -> bool:
    """Whether a text names a class of the user."""
    return isinstance(value, str) and (":" in value or value.endswith(".py"))


class MachineReader:
    """Reads a configuration in one pass; after a problem it continues with what does not depend on it.

    Args:
        top: the mapping of the configuration; what is wrong is added to its problems.
        base_dir: folder to which files of effects, controllers and recordings are relative.
        overrides: changes such as "piston_clearance=15 um" that replace values of the mapping.
        trust: the user's code that may run.
        is_result: whether the mapping comes with a result; code is then left out unless `trust` names it.

    Attributes: valid only when there are no problems.
        machine: the machine with its effects and parameters.
        simulation: settings of the run.
        name: name of the configuration.
        recordings: for each section with a recorded input its keys, with the absolute path of its file.
    """

    def __init__(
        self, top: Entry, base_dir: Path, overrides: Sequence[str] = (), trust: Trust = (), is_result: bool = False
    ):
        self.recordings: dict[str, dict[str, str]] = {}
        self._top, self._base_dir = top, base_dir
        self._trust, self._leave_out_code = TrustedCode.of(trust), is_result and TrustedCode.of(trust).names_nothing
        self._controller_left_out, self._effects_left_out = None, ()  # parts of the machine whose code was not run
        self._incomplete = False  # a component or effect could not be read: unknown names may be its parameters
        self._given: dict[tuple[str, str], Entry] = {}  # the parameters set so far, by (path, name)
        settings, self._overrides = self._split_overrides(overrides)
        self._rig = read_rig(top["rig"], base_dir, self._trust)
        self._keys = machine_keys(self._rig or Rig)
        # the drives of a rig of one's own that cannot be read are unknown
        if self._rig is not None or not _names_code(top["rig"].value):
            self._keys.refuse_others(top.mapping(""))
        self.name = self._keys.keys["name"].kind.read(top["name"]) or ""
        self.simulation = read_settings(top["simulation"], settings, self._rig or Rig)
        self.machine = self._machine()

    def _override(self, name: str, value: Any = None) -> Entry:
        """The entry of an override from the command line."""
        return Entry(value, (f"--set {name}",), self._top.problems)

    def _split_overrides(self, overrides: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
        """The overrides of settings and those of parameters, as value by name."""
        settings, parameters = {}, {}
        for text in overrides:
            name, equals, value = (part.strip() for part in text.removeprefix("simulation.").partition("="))
            if not (name and equals and value):
                self._override(text).add("write name=value, for example duration=2s")
            elif name in {*settings, *parameters}:
                self._override(text).add("given twice")
            else:
                (settings if name in SETTING_NAMES else parameters)[name] = value
        return settings, parameters

    def _machine(self) -> Rig | None:
        """The machine of the whole configuration; None without a valid rig."""
        if self._rig is None:
            return None
        m = self._rig()
        for section in (s for s in component_kinds(m) | COMPONENT_KINDS if s in self._keys.keys):
            m = self._section(m, section)
        for read in (self._effects, self._parameters, self._apply_overrides, self._recorded_inputs):
            m = read(m)
        given = {name: entry.key for name, entry in self._given.items()}
        for check in (_check_order, _check_tables, _check_cylinder, _check_chirps, _check_sampling):
            self._top.problems += check(m, given)
        if not self._incomplete:
            self._top.problems += _check_open_loop(m, given)
            try:
                check_derivatives(m)
            except EffectError as error:
                self._top["rig" if is_users_code(type(m)) else "effects"].add(str(error))
        m = structs.replace(m, effects=(*m.effects, *self._effects_left_out))
        return structs.replace(m, controller=self._controller_left_out) if self._controller_left_out else m

    def _section(self, m: Rig, section: str) -> Rig:
        """The machine with the component that a section selects and the parameters that it sets."""
        entry, kinds = self._top[section], component_kinds(m).get(section, {})
        if section not in self._top:
            return m
        if not hasattr(m, section):
            entry.add(f"{m.name} has no {section}; actuator_system has one")
            return m
        value, whole = entry.value, {}
        if (section == "target" or section in m.drives) and not isinstance(value, Mapping | list | bool | None):
            entry, whole = Entry({"kind": "step", "step_size": value}, entry.key, entry.problems), {"step_size": entry}
        given = self._mapping(entry, f"{{kind: {next(iter(kinds))}}}")
        kind = entry["kind"].value if "kind" in entry else config_kind(m, section)
        cls = self._component_class(entry["kind"], kinds, section, kind)
        if cls is None:
            self._incomplete = True
            return m
        if cls is Recorded:
            # a placeholder until all parameters are read: the gain of the amplifier may scale the samples
            self.recordings[section] = dict(entry.value)
            return structs.replace(m, **{section: Recorded(values=np.zeros(2), interval=1.0)})
        if not isinstance(getattr(m, section), cls):
            m = structs.replace(m, **{section: cls()})
        if section == "controller":
            try:
                check_controller(m, self.simulation.precision.value)
            except ControllerError as error:
                entry["kind"].add(str(error))
                self._incomplete = True
                return structs.replace(m, controller=type(m)().controller)
        valid = {p.name: p for p, _, path in list_parameters(m) if path == section}
        for short, inside in given.items():
            name = SHORT_NAMES.get(cls, {}).get(short, short)
            if name in valid:
                m = self._set(m, whole.get(name, inside), section, valid[name])
            elif name != "kind":
                hint = suggest(str(name), valid) if valid else "it has none"
                owners = [k for k, other in kinds.items() if _has_parameter(other, name)]
                if owners and "kind" not in entry:
                    hint = f"write `kind: {owners[0]}`, which has it"
                inside.add(f"unknown parameter of {with_article(section)} of kind {kind}; {hint}")
        return m

    def _mapping(self, entry: Entry, example: str) -> dict[str, Entry]:
        """The entries of a section; after a problem the machine is incomplete."""
        self._incomplete |= not isinstance(entry.value, Mapping | None)
        return entry.mapping(example)

    def _component_class(self, entry: Entry, kinds: Mapping[str, type], section: str, kind: Any) -> type | None:
        """The class that `kind` names, which for a controller may be the user's own; None after a problem."""
        if isinstance(kind, str) and kind in kinds:
            return kinds[kind]
        if section == "controller" and isinstance(kind, type) and issubclass(kind, Controller):
            return kind
        message = f"the name of a kind belongs here, not {yaml_type(kind)}; {suggest('', kinds)}"
        if isinstance(kind, str):
            message = f"no {section} of kind `{kind}`; {suggest(kind, kinds)}"
        if section == "controller" and _names_code(kind):
            try:
                return load_controller(kind, self._base_dir, self._trust)
            except ControllerError as error:
                message = str(error)
                if self._leave_out_code:
                    self._controller_left_out = controller_not_run(kind)
                    return None
        return entry.add(message)

    def _effects(self, m: Rig) -> Rig:
        """The machine with the effects of the configuration, each checked on the machine with those before it."""
        entry = self._top["effects"]
        self._incomplete |= not isinstance(entry.value, list | tuple | None)
        listed = entry.list("[lugre_friction]")
        usual = self._usual_effects(m, [inside.value for inside in listed], listed)
        for inside in (*listed, *usual):
            spec, before = inside.value, len(inside.problems)
            try:
                effect = self._effect(inside, rig_of(m))
                if len(inside.problems) == before:
                    check_effect(effect, m, self.simulation.precision.value)
                    m = structs.replace(m, effects=(*m.effects, effect))
            except LawError as error:
                for line in str(error).splitlines():
                    inside.add(line)
            except (EffectError, UnitError) as error:
                if self._leave_out_code and isinstance(spec, str) and ":" in spec:
                    self._effects_left_out += (effect_not_run(spec),)
                    self._incomplete = True
                else:
                    inside.add(str(error))
            self._incomplete |= len(inside.problems) > before
        return m

    def _usual_effects(self, m: Rig, names: list[Any], listed: list[Entry]) -> list[Entry]:
        """With a list `without`, the usual effects that the rig can have, but neither this list nor `effects` names."""
        available = [effect.id for effect in m.usual_effects]
        without = self._top["without"].list("[lugre_friction]")
        for inside in without:
            if inside.value not in available:
                hint = suggest(str(inside.value), available)
                inside.add(f"no refined effect `{inside.value}` of this rig; {hint}")
        left_out = [inside.value for inside in without]
        for inside in listed:
            if inside.value in left_out:
                inside.add(f"`{inside.value}` is listed under `without` too")
        if "without" not in self._top:
            return []
        more = [name for name in available if name not in (*left_out, *names)]
        return [Entry(name, ("without",), self._top.problems) for name in more]

    def _effect(self, entry: Entry, rig: type[Rig] | None) -> Effect | None:
        """The effect that an entry names; None after problems of a law.

        Raises:
            LawError: the file of a tabulated law has problems.
            EffectError: it cannot be loaded.
            UnitError: a parameter is declared in an unknown unit.
        """
        spec = entry.value
        if isinstance(spec, Mapping):
            law = read_law(entry, None, rig)
            return law and law.effect()
        if isinstance(spec, str) and spec.endswith(LAW_SUFFIXES):
            return read_law_file(self._base_dir / spec, rig).effect()
        if isinstance(spec, type) and issubclass(spec, Effect):
            cls = spec
        elif isinstance(spec, str):
            cls = load_effect(spec, self._base_dir, self._trust)
        else:
            what = "the id of an effect, file.py:ClassName or the file of a tabulated law"
            raise EffectError(f"{what} belongs here, not {yaml_type(spec)}")
        for p in structs.parameters(cls):
            try:
                to_si("1" if p.unit == "-" else f"1 {p.unit}", p.unit)
            except UnitError:
                raise UnitError(f'{cls.__name__}.{p.name} is declared in "{p.unit}", which is not a unit') from None
        return cls()

    def _parameters(self, m: Rig) -> Rig:
        for name, entry in self._mapping(self._top["parameters"], "{frequency: 20 Hz}").items():
            m = self._find_and_set(m, entry, str(name))
        return m

    def _apply_overrides(self, m: Rig) -> Rig:
        for name, value in self._overrides.items():
            entry = self._override(name, value)
            if (name == "target" or name in m.drives) and hasattr(getattr(m, name, None), "step_size"):
                name = f"{name}.step_size"
            m = self._find_and_set(m, entry, name)
        return m

    def _find_and_set(self, m: Rig, entry: Entry, name: str) -> Rig:
        """The machine with the parameter `name` (or `owner.name`) set."""
        try:
            p, path = find_parameter(m, name)
        except ParameterError as error:
            if not self._incomplete or "ambiguous" in str(error):
                entry.add(str(error))
            return m
        is_override = str(entry.key[0]).startswith("--set ")
        if is_override and not str(self._given.get((path, p.name), entry).key[0]).startswith("--set "):
            self._given.pop((path, p.name), None)  # an override may replace a value of the configuration
        return self._set(m, entry, path, p)

    def _set(self, m: Rig, entry: Entry, path: str, p: Parameter) -> Rig:
        """The machine with one parameter set; unchanged after a problem."""
        if (path, p.name) in self._given:
            entry.add(f"given twice, also as {key_text(self._given[path, p.name].key)}")
            return m
        self._given[path, p.name] = entry
        value = quantity(p).read(entry)
        return m if value is None else replace_value(m, path, p.name, value)

    def _recorded_inputs(self, m: Rig) -> Rig:
        """The machine with the samples of its recorded inputs."""
        for section in list(self.recordings):
            entry, before = self._top[section], len(self._top.problems)
            keys = RECORDING.read(entry)
            if "file" not in entry and "samples" not in entry:
                entry["file"].add("missing; write for example `file: bench.csv`")
            if len(self._top.problems) > before:
                continue
            try:
                recorded = decode_samples(entry.value) if "samples" in entry else self._recording(m, section, keys)
            except RecordingError as error:
                entry[error.key].add(str(error))
                continue
            m = structs.replace(m, **{section: recorded})
        return m

    def _recording(self, m: Rig, section: str, keys: Mapping[str, Any]) -> Recorded:
        """The recording in the file that a section names, in the unit of the drive."""
        unit = m.drive_unit(section)
        amplifier = getattr(m, "amplifier", None) if section == "reference" and unit == "V" else None
        gain = amplifier.amplifier_gain if isinstance(amplifier, CurrentAmplifier) else None
        path = self._base_dir / keys["file"]
        recorded = read_recording(path, keys["column"], keys["unit"], unit, gain, keys["between"])
        self.recordings[section] |= {"file": str(path.resolve())}
        return recorded


def _has_parameter(cls: type, name: str) -> bool:
    """Whether a component has a parameter of this name, full or short."""
    return SHORT_NAMES.get(cls, {}).get(name, name) in (p.name for p in structs.parameters(cls))


# checks of what the range of a single parameter cannot express


def _key(given: Given, *names: tuple[str, str]) -> KeyPath:
    """Where a configuration sets one of some parameters, the first that it sets; the first name where it sets none."""
    return next((given[name] for name in names if name in given), names[0])


def _check_order(m: Rig, given: Given) -> Iterator[Problem]:
    for path, p, problem in order_problems(m):
        if path not in ORDER_CHECKED_BELOW:
            yield _key(given, (path, p.name), (path, p.at_least)), problem


def _check_tables(m: Rig, given: Given) -> Iterator[Problem]:
    for effect in m.effects:
        table = table_of(effect)
        for k in () if table is None else np.flatnonzero(np.diff(table.nodes) == 0.0):
            key = _key(given, (effect.id, f"node_{k + 2}"), (effect.id, f"node_{k + 1}"))
            yield key, f"node_{k + 1} and node_{k + 2} of {effect.id} coincide; nodes must increase"


def _check_cylinder(m: Rig, given: Given) -> Iterator[Problem]:
    if isinstance(getattr(m, "cylinder", None), Cylinder) and not m.cylinder.cylinder_rod < m.cylinder.cylinder_bore:
        key = given.get(("cylinder", "cylinder_rod"), _key(given, ("cylinder", "cylinder_bore")))
        rod, bore = (format_quantity(x, "m") for x in (m.cylinder.cylinder_rod, m.cylinder.cylinder_bore))
        yield key, f"the rod ({rod}) must be thinner than the bore ({bore}) of the cylinder"


def _check_chirps(m: Rig, given: Given) -> Iterator[Problem]:
    for section in dict.fromkeys((*m.drives, "reference", "target")):
        for name in ("start_frequency", "end_frequency"):
            if getattr(getattr(m, section, None), name, 1.0) <= 0.0:
                yield _key(given, (section, name)), "must be above 0 Hz for a chirp"


def _check_sampling(m: Rig, given: Given) -> Iterator[Problem]:
    sampling = getattr(m, "sampling", None)
    if isinstance(sampling, Sampled) and sampling.computation_delay > sampling.sample_time:
        key = given.get(("sampling", "computation_delay"), ("sampling", "sample_time"))
        limit = format_quantity(sampling.sample_time, "s")
        yield key, f"at most one sample time ({limit}) can pass from a sample to its command"


def _check_open_loop(m: Rig, given: Given) -> Iterator[Problem]:
    reference = getattr(m, "reference", None)
    if isinstance(getattr(m, "controller", None), OpenLoop) and not isinstance(reference, Recorded | None):
        name = "step_size" if hasattr(reference, "step_size") else "amplitude"
        if ("reference", name) not in given:
            message = "missing; with an open-loop controller the reference is the command"
            yield ("reference", name), f"{message}, write for example `{name}: 12 V`"
