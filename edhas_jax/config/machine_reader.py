"""Reads the mapping of a configuration: makes the machine and the settings of its run, or lists all problems."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.code_not_run import controller_not_run, effect_not_run
from edhas_jax.config.effects_reader import read_effect
from edhas_jax.config.law_reader import LawError
from edhas_jax.config.machine_checks import check_machine
from edhas_jax.config.recorded_signal import (
    RECORDING_KEYS,
    Between,
    RecordingError,
    decode_samples,
    read_between,
    read_recording,
)
from edhas_jax.config.rig_reader import names_own_rig, own_keys, read_rig
from edhas_jax.config.run_settings import SETTING_NAMES, quantity_text, read_settings
from edhas_jax.config.writer import config_kind
from edhas_jax.config.yaml_with_lines import KeyPath, key_text, yaml_type
from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, with_article
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.tabulated_law import rig_of
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.controller_base import Controller, ControllerError
from edhas_jax.machine.parameters import (
    COMPONENT_KINDS,
    ParameterError,
    component_kinds,
    find_parameter,
    list_parameters,
    parse_value,
    replace_value,
)
from edhas_jax.machine.rig_base import Rig
from edhas_jax.machine.user_controller import check_controller, load_controller

SHORT_KEYS = {"from": "step_from"}  # keys of a section that no parameter can have: a keyword of Python
TOP_LEVEL_KEYS = ("name", "rig", "effects", "parameters", *COMPONENT_KINDS, "simulation")


class MachineReader:
    """Reads a configuration in one pass; after a problem it continues with what does not depend on it.

    Args:
        data: the mapping of the configuration.
        base_dir: folder to which files of effects, controllers and recordings are relative.
        overrides: changes such as "piston_clearance=15 um" that replace values of the mapping.
        trust: the user's code that may run.
        is_result: whether the mapping comes with a result; code is then left out unless `trust` names it.

    Attributes:
        problems: key and message of every problem. The other attributes are valid only when there are none.
        machine: the machine with its effects and parameters.
        simulation: settings of the run.
        name: name of the configuration.
        recordings: for each section with a recorded input its keys, with the absolute path of its file.
    """

    def __init__(
        self, data: Mapping[str, Any], base_dir: Path, overrides: Sequence[str], trust: Trust = (),
        is_result: bool = False,
    ):  # fmt: skip
        self.problems: list[tuple[KeyPath, str]] = []
        self.recordings: dict[str, dict[str, str]] = {}
        self._data, self._base_dir = data, base_dir
        self._trust, self._leave_out_code = TrustedCode.of(trust), is_result and TrustedCode.of(trust).names_nothing
        self._controller_left_out, self._effects_left_out = None, ()  # parts of the machine whose code was not run
        self._incomplete = False  # a component or effect could not be read: unknown names may be its parameters
        self._given: dict[tuple[str, str], KeyPath] = {}  # keys of the parameters set so far, by (path, name)
        settings, self._overrides = self._split_overrides(overrides)
        self._rig = read_rig(data.get("rig"), base_dir, self._trust, self._add)
        self._keys = known = TOP_LEVEL_KEYS if self._rig is None or not self._rig.is_own else own_keys(self._rig)
        is_unread = self._rig is None and names_own_rig(data.get("rig"))  # its drives are not known
        for key in data:
            if key not in known and not is_unread:
                self._add((key,), f"unknown key; {suggest(str(key), known)}")
        self.name = "" if data.get("name") is None else data["name"]
        if not isinstance(self.name, str):
            self._add(("name",), f"a text belongs here, not {yaml_type(self.name)}")
        self.simulation = read_settings(
            self._mapping("simulation", "{duration: 0.5 s}"), settings, self._add, self._rig or Rig
        )
        self.machine = self._machine()

    def _add(self, key: KeyPath, message: str) -> None:
        self.problems.append((key, message))

    def _split_overrides(self, overrides: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
        """The overrides of settings and those of parameters, as value by name."""
        settings, parameters = {}, {}
        for text in overrides:
            name, equals, value = (part.strip() for part in text.removeprefix("simulation.").partition("="))
            if not (name and equals and value):
                self._add((f"--set {text}",), "write name=value, for example duration=2s")
            elif name in {*settings, *parameters}:
                self._add((f"--set {text}",), "given twice")
            else:
                (settings if name in SETTING_NAMES else parameters)[name] = value
        return settings, parameters

    def _machine(self) -> Rig | None:
        """The machine of the whole configuration; None without a valid rig."""
        if self._rig is None:
            return None
        m = self._rig()
        for section in (s for s in {**m.drives, **COMPONENT_KINDS} if s in self._keys):
            m = self._section(m, section)
        for read in (self._effects, self._parameters, self._apply_overrides, self._recorded_inputs):
            m = read(m)
        self.problems += check_machine(m, self._given, self._incomplete)
        m = structs.replace(m, effects=(*m.effects, *self._effects_left_out))
        return structs.replace(m, controller=self._controller_left_out) if self._controller_left_out else m

    def _mapping(self, section: str, example: str) -> Mapping[str, Any]:
        """A section that must be a mapping; empty if it is missing or after a problem."""
        value = self._data.get(section)
        if value is None or isinstance(value, Mapping):
            return value or {}
        self._add((section,), f"a mapping belongs here, for example `{section}: {example}`, not {yaml_type(value)}")
        self._incomplete = True
        return {}

    def _section(self, m: Rig, section: str) -> Rig:
        """The machine with the component that a section selects and the parameters that it sets."""
        kinds = component_kinds(m).get(section, {})
        if section not in self._data:
            return m
        if not hasattr(m, section):
            self._add((section,), f"{m.name} has no {section}; actuator_system has one")
            return m
        value = self._data[section]
        if (section == "target" or section in m.drives) and not isinstance(value, Mapping | list | bool | None):
            value = {"kind": "step", "step_size": value}
            keys = {"step_size": (section,)}
        else:
            value, keys = self._mapping(section, f"{{kind: {next(iter(kinds))}}}"), {}
        kind = value.get("kind", config_kind(m, section))
        cls = self._component_class(kinds, section, kind)
        if cls is None:
            self._incomplete = True
            return m
        if cls is Recorded:
            # a placeholder until all parameters are read: the gain of the amplifier may scale the samples
            self.recordings[section] = dict(value)
            return structs.replace(m, **{section: Recorded(values=np.zeros(2), interval=1.0)})
        if not isinstance(getattr(m, section), cls):
            m = structs.replace(m, **{section: cls()})
        if section == "controller":
            try:
                check_controller(m, self.simulation.precision.value)
            except ControllerError as error:
                self._add((section, "kind"), str(error))
                self._incomplete = True
                return structs.replace(m, controller=type(m)().controller)
        valid = {p.name: p for p, _, path in list_parameters(m) if path == section}
        for name, quantity in value.items():
            if name == "kind":
                continue
            key = keys.get(name, (section, name))
            name = SHORT_KEYS.get(name, name)
            if name in valid:
                m = self._set(m, key, section, valid[name], quantity)
            else:
                hint = suggest(str(name), valid) if valid else "it has none"
                owners = [k for k, other in kinds.items() if name in (p.name for p in structs.parameters(other))]
                if owners and "kind" not in value:
                    hint = f"write `kind: {owners[0]}`, which has it"
                self._add(key, f"unknown parameter of {with_article(section)} of kind {kind}; {hint}")
        return m

    def _component_class(self, kinds: Mapping[str, type], section: str, kind: Any) -> type | None:
        """The class that `kind` names, which for a controller may be the user's own; None after a problem."""
        if isinstance(kind, str) and kind in kinds:
            return kinds[kind]
        if section == "controller" and isinstance(kind, type) and issubclass(kind, Controller):
            return kind
        message = f"the name of a kind belongs here, not {yaml_type(kind)}; {suggest('', kinds)}"
        if isinstance(kind, str):
            message = f"no {section} of kind `{kind}`; {suggest(kind, kinds)}"
        if section == "controller" and isinstance(kind, str) and (":" in kind or kind.endswith(".py")):
            try:
                return load_controller(kind, self._base_dir, self._trust)
            except ControllerError as error:
                message = str(error)
                if self._leave_out_code:
                    self._controller_left_out = controller_not_run(kind)
                    return None
        self._add((section, "kind"), message)
        return None

    def _effects(self, m: Rig) -> Rig:
        """The machine with the effects of the configuration, each checked on the machine with those before it."""
        specs = self._data.get("effects")
        if not isinstance(specs, list | tuple | None):
            example = "for example `effects: [lugre_friction]`"
            self._add(("effects",), f"a list belongs here, {example}, not {yaml_type(specs)}")
            self._incomplete = True
            return m
        for i, spec in enumerate(specs or ()):
            try:
                effect = read_effect(spec, self._base_dir, self._trust, rig_of(m))
                check_effect(effect, m, self.simulation.precision.value)
                m = structs.replace(m, effects=(*m.effects, effect))
            except LawError as error:
                self._incomplete = True
                self.problems += [(("effects", i, *key), message) for key, message in error.problems]
            except (EffectError, UnitError) as error:
                self._incomplete = True
                if self._leave_out_code and isinstance(spec, str) and ":" in spec:
                    self._effects_left_out += (effect_not_run(spec),)
                else:
                    self._add(("effects", i), str(error))
        return m

    def _parameters(self, m: Rig) -> Rig:
        for name, value in self._mapping("parameters", "{frequency: 20 Hz}").items():
            m = self._find_and_set(m, ("parameters", name), str(name), value)
        return m

    def _apply_overrides(self, m: Rig) -> Rig:
        for name, value in self._overrides.items():
            key = (f"--set {name}",)
            if (name == "target" or name in m.drives) and hasattr(getattr(m, name, None), "step_size"):
                name = f"{name}.step_size"
            m = self._find_and_set(m, key, name, value)
        return m

    def _find_and_set(self, m: Rig, key: KeyPath, name: str, value: Any) -> Rig:
        """The machine with the parameter `name` (or `owner.name`) set."""
        try:
            p, path = find_parameter(m, name)
        except ParameterError as error:
            if not self._incomplete or "ambiguous" in str(error):
                self._add(key, str(error))
            return m
        if key[0] != "parameters" and not self._given.get((path, p.name), key)[0].startswith("--set "):
            self._given.pop((path, p.name), None)  # an override may replace a value of the configuration
        return self._set(m, key, path, p, value)

    def _set(self, m: Rig, key: KeyPath, path: str, p: Parameter, value: Any) -> Rig:
        """The machine with one parameter set; unchanged after a problem."""
        if (path, p.name) in self._given:
            self._add(key, f"given twice, also as {key_text(self._given[path, p.name])}")
            return m
        self._given[path, p.name] = key
        try:
            return replace_value(m, path, p.name, parse_value(p, quantity_text(p, value)))
        except (ParameterError, UnitError) as error:
            self._add(key, str(error))
            return m

    def _recorded_inputs(self, m: Rig) -> Rig:
        """The machine with the samples of its recorded inputs."""
        for section, keys in list(self.recordings.items()):
            for name, value in keys.items():
                if name not in RECORDING_KEYS:
                    valid = suggest(str(name), RECORDING_KEYS)
                    self._add((section, name), f"unknown key of a recorded {section}; {valid}")
                elif not isinstance(value, str):
                    self._add((section, name), f"a text belongs here, not {yaml_type(value)}")
            if "file" not in keys and "samples" not in keys:
                self._add((section, "file"), "missing; write for example `file: bench.csv`")
            if any(key[0] == section for key, _ in self.problems):
                continue
            try:
                recorded = decode_samples(keys) if "samples" in keys else self._recording_file(m, section)
            except RecordingError as error:
                self._add((section, error.key), str(error))
                continue
            m = structs.replace(m, **{section: recorded})
        return m

    def _recording_file(self, m: Rig, section: str) -> Recorded:
        """The recording in the file that a section names, in the unit of the drive."""
        keys = self.recordings[section]
        unit = m.drive_unit(section)
        amplifier = getattr(m, "amplifier", None) if section == "reference" and unit == "V" else None
        gain = amplifier.amplifier_gain if isinstance(amplifier, CurrentAmplifier) else None
        path = self._base_dir / keys["file"]
        between = read_between(keys["between"]) if "between" in keys else Between.LINE
        recorded = read_recording(path, keys.get("column"), keys.get("unit"), unit, gain, between)
        self.recordings[section] = {**keys, "file": str(path.resolve())}
        return recorded
