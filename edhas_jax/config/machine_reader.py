"""The reader of a configuration: plain data → a machine and the settings of its run, or every problem there is."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jax.numpy as jnp

from edhas_jax.config.recorded_signal import RECORDING_KEYS, RecordingError, decode_samples, read_recording
from edhas_jax.config.run_settings import SETTING_NAMES, quantity_text, read_settings
from edhas_jax.config.writer import config_kind
from edhas_jax.config.yaml_with_lines import KeyPath, key_text, yaml_type
from edhas_jax.core import structs
from edhas_jax.core.names import nearest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si, with_article
from edhas_jax.machine.components.coil_and_amplifier import CurrentAmplifier
from edhas_jax.machine.components.controller_sampling import Sampled
from edhas_jax.machine.components.controllers import OpenLoop
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import Effect, EffectError
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.controller_base import Controller, ControllerError
from edhas_jax.machine.parameters import KINDS, ParameterError, find_parameter, list_parameters, put, read_value
from edhas_jax.machine.rigs import RIGS, Rig
from edhas_jax.machine.user_controller import check_controller, load_controller

TOP_LEVEL_KEYS = ("name", "rig", "effects", "parameters", *KINDS, "simulation")


class MachineReader:
    """One pass over a mapping: it gathers problems and goes on wherever what follows does not depend on them.

    `machine`, `simulation`, `name` and `recordings` are worth something only when `problems` is empty.
    """

    def __init__(self, data: Mapping[str, Any], base_dir: Path, overrides: Sequence[str]):
        self.problems: list[tuple[KeyPath, str]] = []
        self.recordings: dict[str, dict[str, str]] = {}
        self._data, self._base_dir = data, base_dir
        self._incomplete = False  # a part or an effect is missing, so that names of its parameters are no errors
        self._given: dict[tuple[str, str], KeyPath] = {}
        settings, self._overrides = self._split(overrides)
        for key in data:
            if key not in TOP_LEVEL_KEYS:
                self._add((key,), f"unknown key; {nearest(str(key), TOP_LEVEL_KEYS)}")
        self.name = "" if data.get("name") is None else data["name"]
        if not isinstance(self.name, str):
            self._add(("name",), f"a text belongs here, not {yaml_type(self.name)}")
        self.simulation = read_settings(self._mapping("simulation", "{duration: 0.5 s}"), settings, self._add)
        self.machine = self._machine()

    def _add(self, key: KeyPath, what: str) -> None:
        self.problems.append((key, what))

    def _split(self, overrides: Sequence[str]) -> tuple[dict[str, str], dict[str, str]]:
        """The overrides of settings, and those of parameters."""
        settings, others = {}, {}
        for text in overrides:
            name, equals, value = (part.strip() for part in text.partition("="))
            if not (name and equals and value):
                self._add((f"--set {text}",), "write name=value, for example duration=2s")
            elif name.removeprefix("simulation.") in SETTING_NAMES:
                settings[name.removeprefix("simulation.")] = value
            else:
                others[name] = value
        return settings, others

    def _machine(self) -> Rig | None:
        rig = self._data.get("rig")
        if rig is None:
            self._add(("rig",), f"missing; one of {', '.join(RIGS)}")
        elif not isinstance(rig, str):
            self._add(("rig",), f"a text belongs here, not {yaml_type(rig)}; one of {', '.join(RIGS)}")
        elif rig not in RIGS:
            self._add(("rig",), f"no rig `{rig}`; {nearest(rig, RIGS)}")
        else:
            m = RIGS[rig]()
            for section in KINDS:
                m = self._section(m, section)
            for read in (self._effects, self._parameters, self._overridden, self._recorded):
                m = read(m)
            self._cross_check(m)
            return m
        return None

    def _mapping(self, section: str, example: str) -> Mapping[str, Any]:
        value = self._data.get(section)
        if value is None or isinstance(value, Mapping):
            return value or {}
        self._add((section,), f"a mapping belongs here, for example `{section}: {example}`, not {yaml_type(value)}")
        self._incomplete = True
        return {}

    def _section(self, m: Rig, section: str) -> Rig:
        kinds = KINDS[section]
        if section not in self._data:
            return m
        if not hasattr(m, section):
            self._add((section,), f"{m.name} has no {section}; actuator_system has one")
            return m
        value = self._data[section]
        if section == "target" and not isinstance(value, Mapping | list | bool | None):
            value = {"kind": "step", "step_size": value}
            keys = {"step_size": (section,)}
        else:
            value, keys = self._mapping(section, f"{{kind: {next(iter(kinds))}}}"), {}
        kind = value.get("kind", config_kind(section, getattr(m, section)))
        cls = self._kind(section, kind)
        if cls is None:
            self._incomplete = True
            return m
        if cls is Recorded:
            # a stand-in until the parameters are known: the gain of the amplifier may scale the samples
            self.recordings[section] = dict(value)
            return structs.replace(m, **{section: Recorded(values=jnp.zeros(2), interval=1.0)})
        if not isinstance(getattr(m, section), cls):
            m = structs.replace(m, **{section: cls()})
        if section == "controller":
            try:
                check_controller(m, self.simulation.precision.value)
            except ControllerError as error:
                self._add((section, "kind"), str(error))
                self._incomplete = True
                return structs.replace(m, controller=type(m)().controller)
        own = {p.name: p for p, _, path in list_parameters(m) if path == section}
        for name, quantity in value.items():
            if name == "kind":
                continue
            key = keys.get(name, (section, name))
            if name in own:
                m = self._put(m, key, section, own[name], quantity)
            else:
                valid = nearest(str(name), own) if own else "it has none"
                has = [k for k, other in kinds.items() if name in (p.name for p in structs.parameters(other))]
                hint = f"write `kind: {has[0]}`, which has it" if has and "kind" not in value else valid
                self._add(key, f"unknown parameter of {with_article(section)} of kind {kind}; {hint}")
        return m

    def _kind(self, section: str, kind: Any) -> type | None:
        """The class that `kind` names; None after a problem. A controller may be one of the user's."""
        kinds = KINDS[section]
        if isinstance(kind, str) and kind in kinds:
            return kinds[kind]
        if section == "controller" and isinstance(kind, type) and issubclass(kind, Controller):
            return kind
        what = f"the name of a kind belongs here, not {yaml_type(kind)}; {nearest('', kinds)}"
        if isinstance(kind, str):
            what = f"no {section} of kind `{kind}`; {nearest(kind, kinds)}"
        if section == "controller" and isinstance(kind, str) and (":" in kind or kind.endswith(".py")):
            try:
                return load_controller(kind, self._base_dir)
            except ControllerError as error:
                what = str(error)
        self._add((section, "kind"), what)
        return None

    def _effects(self, m: Rig) -> Rig:
        specs = self._data.get("effects")
        if not isinstance(specs, list | tuple | None):
            example = "for example `effects: [lugre_friction]`"
            self._add(("effects",), f"a list belongs here, {example}, not {yaml_type(specs)}")
            self._incomplete = True
            return m
        for i, spec in enumerate(specs or ()):
            try:
                effect = self._effect(spec)
                check_effect(effect, m, self.simulation.precision.value)
                m = structs.replace(m, effects=(*m.effects, effect))
            except (EffectError, UnitError) as error:
                self._add(("effects", i), str(error))
                self._incomplete = True
        return m

    def _effect(self, spec: Any) -> Effect:
        if isinstance(spec, type) and issubclass(spec, Effect):
            cls = spec
        elif isinstance(spec, str):
            cls = load_effect(spec, self._base_dir)
        else:
            raise EffectError(f"the id of an effect or file.py:ClassName belongs here, not {yaml_type(spec)}")
        for p in structs.parameters(cls):
            try:
                to_si("1" if p.unit == "-" else f"1 {p.unit}", p.unit)
            except UnitError:
                raise UnitError(f'{cls.__name__}.{p.name} is declared in "{p.unit}", which is not a unit') from None
        return cls()

    def _parameters(self, m: Rig) -> Rig:
        for name, value in self._mapping("parameters", "{frequency: 20 Hz}").items():
            m = self._find_and_put(m, ("parameters", name), str(name), value)
        return m

    def _overridden(self, m: Rig) -> Rig:
        for name, value in self._overrides.items():
            key = (f"--set {name}",)
            if name == "target" and hasattr(m, "target") and hasattr(m.target, "step_size"):
                name = "target.step_size"
            m = self._find_and_put(m, key, name, value)
        return m

    def _find_and_put(self, m: Rig, key: KeyPath, name: str, value: Any) -> Rig:
        try:
            p, path = find_parameter(m, name)
        except ParameterError as error:
            if not self._incomplete or "ambiguous" in str(error):
                self._add(key, str(error))
            return m
        if key[0] != "parameters":
            self._given.pop((path, p.name), None)  # an override may come on top
        return self._put(m, key, path, p, value)

    def _put(self, m: Rig, key: KeyPath, path: str, p: Parameter, value: Any) -> Rig:
        if (path, p.name) in self._given:
            self._add(key, f"given twice, also as {key_text(self._given[path, p.name])}")
            return m
        self._given[path, p.name] = key
        try:
            return put(m, path, p.name, read_value(p, quantity_text(p, value)))
        except (ParameterError, UnitError) as error:
            self._add(key, str(error))
            return m

    def _recorded(self, m: Rig) -> Rig:
        for section, keys in list(self.recordings.items()):
            for name, value in keys.items():
                if name not in RECORDING_KEYS:
                    valid = nearest(str(name), RECORDING_KEYS)
                    self._add((section, name), f"unknown key of a recorded {section}; {valid}")
                elif not isinstance(value, str):
                    self._add((section, name), f"a text belongs here, not {yaml_type(value)}")
            if "file" not in keys and "samples" not in keys:
                self._add((section, "file"), "missing; write for example `file: bench.csv`")
            if any(k[0] == section for k, _ in self.problems):
                continue
            try:
                recorded = decode_samples(keys) if "samples" in keys else self._file(m, section)
            except RecordingError as error:
                self._add((section, error.key), str(error))
                continue
            m = structs.replace(m, **{section: recorded})
        return m

    def _file(self, m: Rig, section: str) -> Recorded:
        """The recording in the file that a section names; a command is in volts, a set point in metres."""
        keys = self.recordings[section]
        replay = section == "reference" and isinstance(m.controller, OpenLoop)
        gain = m.amplifier.amplifier_gain if replay and isinstance(m.amplifier, CurrentAmplifier) else None
        path = self._base_dir / keys["file"]
        recorded = read_recording(path, keys.get("column"), keys.get("unit"), "V" if replay else "m", gain)
        self.recordings[section] = {**keys, "file": str(path.resolve())}
        return recorded

    def _cross_check(self, m: Rig) -> None:
        if hasattr(m, "cylinder") and not m.cylinder.cylinder_rod < m.cylinder.cylinder_bore:
            names = [("cylinder", name) for name in ("cylinder_rod", "cylinder_bore")]
            key = next((self._given[name] for name in names if name in self._given), names[1])
            rod, bore = (format_quantity(x, "m") for x in (m.cylinder.cylinder_rod, m.cylinder.cylinder_bore))
            self._add(key, f"the rod ({rod}) must be thinner than the bore ({bore}) of the cylinder")
        for name in ((path, end) for path in ("reference", "target") for end in ("start_frequency", "end_frequency")):
            if getattr(getattr(m, name[0], None), name[1], 1.0) <= 0.0:
                self._add(self._given.get(name, name), "must be above 0 Hz (a chirp runs through frequencies)")
        if isinstance(m.sampling, Sampled) and m.sampling.computation_delay > m.sampling.sample_time:
            key = self._given.get(("sampling", "computation_delay"), ("sampling", "sample_time"))
            most = format_quantity(m.sampling.sample_time, "s")
            self._add(key, f"at most one sample time ({most}) can pass from a sample to its command")
        if isinstance(m.controller, OpenLoop) and not isinstance(m.reference, Recorded) and not self._incomplete:
            name = "step_size" if hasattr(m.reference, "step_size") else "amplitude"
            if ("reference", name) not in self._given:
                what = "missing; with an open-loop controller the reference is the command"
                self._add(("reference", name), f"{what}, write for example `{name}: 12 V`")
