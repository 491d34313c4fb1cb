"""The reader of a campaign: a folder with `campaign.yaml` and one file per run → a `Campaign`."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp

from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.recorded_signal import encode_samples
from edhas_jax.config.yaml_with_lines import (
    YamlError,
    key_text,
    line_of,
    parse_yaml,
    read_text_file,
    yaml_type,
)
from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import COMPONENT_KINDS, ParameterError, find_parameter, list_parameters
from edhas_jax.machine.rigs import RIGS, Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Channel, Remark, Severity, Use
from edhas_jax.measurements.run_reader import ColumnSource, RunReader
from edhas_jax.simulation.integrator import evaluate_signals

CAMPAIGN_FILE = "campaign.yaml"
DEFAULT_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)
TOP = (
    "name", "rig", "parameters", "without", "uncertain", "amplifier", "controller", "reference", "time", "signals",
    "runs",
)  # fmt: skip
SHORT = {
    "amplifier": {"gain": "amplifier_gain"},
    "cascade": {"kp": "cascade_position_gain", "kv": "cascade_velocity_gain"},
    "position": {
        "kp": "position_gain",
        "ki": "integral_gain",
        "kd": "velocity_gain",
        "kaw": "antiwindup_gain",
        "kff": "emf_feedforward",
    },  # fmt: skip
}


def read_campaign(path: Path | str) -> Campaign:
    """The campaign in a folder, or in the folder of a `campaign.yaml`.

    What is unsound in the files of the runs is left out or kept as it is, and `Campaign.remarks` says so.

    Raises:
        CampaignError: `campaign.yaml` is wrong (every problem, one line each), or no run can be used.
    """
    path = Path(path)
    path = path / CAMPAIGN_FILE if path.is_dir() else path
    try:
        data, lines, problems = parse_yaml(read_text_file(path, CampaignError))
    except YamlError as error:
        raise CampaignError(f"{path}:{error.line}: {error}" if error.line else f"{path}: {error}") from None
    reader = CampaignReader(data, path.parent)
    problems += [(line_of(lines, key), f"{key_text(key)}: {what}") for key, what in reader.problems]
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise CampaignError("\n".join(dict.fromkeys(f"{path}:{line}: {what}" for line, what in problems)))
    remarks = [
        Remark(severity, path, line_of(lines, key), f"{key_text(key)}: {what}")
        for severity, key, what in reader.remarks
    ]
    runs, said = reader.read_runs()
    remarks += said
    if not runs:
        raise CampaignError("\n".join([*map(str, remarks), f"{path}: no run can be used"]))
    machine = reader.machine
    if runs[0].reference is not None:
        machine = structs.replace(machine, reference=runs[0].reference)
    return Campaign(reader.name, path.parent, machine, reader.uncertain, reader.channels, tuple(runs), tuple(remarks))


class CampaignReader(ProblemList):
    """One pass over a campaign's mapping; what it has read is worth something only when there are no problems."""

    def __init__(self, data: Mapping[str, Any], folder: Path):
        super().__init__([])
        self.remarks: list[tuple[Severity, tuple, str]] = []
        self._data, self._folder = data, folder
        self.add_unknown_keys((), data, TOP)
        self.name = str(data.get("name") or folder.resolve().name)
        reference = data.get("reference")
        self._set_point = reference if isinstance(reference, str) else None
        self.machine = self._machine()
        self.uncertain: dict[str, float] = {}
        self.channels: dict[str, Channel] = {}
        self._sources: dict[str, ColumnSource] = {}
        self._time = self._clock()
        self._runs: list[tuple[str, Path, Use, dict[str, float]]] = []
        if self.machine is not None:
            self._read_uncertain()
            self._read_signals()
            self._read_runs()

    def read_runs(self) -> tuple[list[BenchRun], list[Remark]]:
        """The runs whose files can be used, and what was noticed in the files of all."""
        reader = RunReader(self.machine, self._time, self._sources, self._set_point)
        runs = [reader.read(*row) for row in self._runs]
        return [run for run in runs if run is not None], reader.remarks

    def _mapping(self, value: Any, key: tuple, example: str) -> Mapping[str, Any]:
        if value is None or isinstance(value, Mapping):
            return value or {}
        self.add(key, f"a mapping belongs here, for example `{example}`, not {yaml_type(value)}")
        return {}

    def _machine(self) -> Rig | None:
        """The engineer's model: a configuration of the rig with all refined effects but those it is said to lack."""
        data = self._data
        config = {key: data[key] for key in ("rig", "parameters", *COMPONENT_KINDS) if key in data}
        for section in ("amplifier", "controller"):
            if isinstance(config.get(section), Mapping):
                kind = config[section].get("kind", "position") if section == "controller" else section
                config[section] = {SHORT.get(kind, {}).get(n, n): v for n, v in config[section].items()}
        if self._set_point:
            stand_in = Recorded(values=jnp.zeros(2), interval=1.0)
            config["reference"] = {"kind": "recorded", **encode_samples(stand_in)}
        rig = RIGS.get(str(data.get("rig")))
        fitting = [effect.id for effect in DEFAULT_EFFECTS if rig is None or set(effect.slots) <= set(rig.slots)]
        without = data.get("without") or []
        if not isinstance(without, list):
            self.add(("without",), f"a list belongs here, for example `[lugre_friction]`, not {yaml_type(without)}")
            without = []
        for at, name in enumerate(without):
            if name not in fitting:
                self.add(("without", at), f"no refined effect `{name}` of this rig; {suggest(str(name), fitting)}")
        config["effects"] = [name for name in fitting if name not in without]
        reader = MachineReader(config, self._folder, ())
        self.problems += reader.problems
        return None if self.problems else reader.machine

    def _find(self, key: tuple, name: str) -> str | None:
        """The name by which a parameter is called here: flat where that is unique."""
        try:
            p, path = find_parameter(self.machine, "target.step_size" if name == "target" else name)
        except ParameterError as error:
            self.add(key, str(error))
            return None
        return p.name if sum(q.name == p.name for q, _, _ in list_parameters(self.machine)) == 1 else f"{path}.{p.name}"

    def _read_uncertain(self) -> None:
        lacking = {p.name: effect.id for effect in DEFAULT_EFFECTS for p in structs.parameters(effect)}
        mounted = {effect.id for effect in self.machine.effects}
        for name, text in self._mapping(self._data.get("uncertain"), ("uncertain",), "coil_resistance: 0.02").items():
            key = ("uncertain", name)
            spread = self._number(key, text, "-", "0.1")
            if spread is None:
                continue
            if name in lacking and lacking[name] not in mounted:
                self.uncertain[name] = spread
                what = f"belongs to {lacking[name]}, which the model is without; it acts only once that is added"
                self.remarks.append((Severity.NOTE, key, what))
            elif (own := self._find(key, name)) is not None:
                self.uncertain[own] = spread

    def _number(self, key: tuple, text: Any, unit: str, example: str) -> float | None:
        """A positive size in SI; the number alone where `unit` is that of the number."""
        try:
            value = to_si(str(text), unit, example)
        except UnitError as error:
            self.add(key, str(error))
            return None
        if not (value > 0.0 and math.isfinite(value)):
            self.add(key, f"must be above 0, for example {example}; got {text}")
            return None
        return value

    def _clock(self) -> ColumnSource:
        given = self._mapping(self._data.get("time"), ("time",), "{column: t, unit: ms}")
        self.add_unknown_keys(("time",), given, ("column", "unit"))
        return ColumnSource(str(given.get("column", "time")), str(given.get("unit", "")))

    def _read_signals(self) -> None:
        given = self._mapping(self._data.get("signals"), ("signals",), "current: {unit: A, noise: 0.02}")
        if not given:
            self.add(("signals",), "missing; name what was measured, such as `current: {unit: A, noise: 0.02}`")
        signals = jax.eval_shape(lambda m: evaluate_signals(m, m.initial_state(), 0.0, 1.0), self.machine)
        here = signals.keys() - {"time"}
        for name, value in given.items():
            key = ("signals", name)
            spec = self._mapping(value, key, "{unit: A, noise: 0.02}")
            self.add_unknown_keys(key, spec, ("unit", "noise", "column"))
            if name not in here:
                why = f"{self.machine.name} has no such signal" if name in SIGNALS else "unknown signal"
                self._leave_out(key, f"{why}; {suggest(str(name), here)}")
                continue
            try:
                unit, si = str(spec.get("unit") or ""), SIGNALS[name].unit
                size = to_si(f"1 {unit}", si, f"1 {SIGNALS[name].display_unit}") - to_si(f"0 {unit}", si)
            except UnitError as error:
                self._leave_out((*key, "unit"), str(error))
                continue
            try:
                noise = float(str(spec.get("noise")))
            except ValueError:
                noise = math.nan
            if not (noise > 0.0 and math.isfinite(noise)):
                got = f"got {spec['noise']}" if "noise" in spec else "it is missing"
                unit = unit or "its unit"
                self._leave_out((*key, "noise"), f"the sensor's standard deviation in {unit} must be above 0; {got}")
                continue
            self.channels[name] = Channel(unit, noise * size)
            self._sources[name] = ColumnSource(str(spec.get("column", name)), unit)
        if given and not self.channels and not self.problems:
            self.problems += [(key, what) for _, key, what in self.remarks if key[0] == "signals"]

    def _leave_out(self, key: tuple, what: str) -> None:
        self.remarks.append((Severity.ERROR, key, f"{what}; the signal is left out"))

    def _read_runs(self) -> None:
        given = self._data.get("runs")
        if not isinstance(given, list) or not given:
            what = f", not {yaml_type(given)}" if given is not None else ""
            self.add(("runs",), f"a list belongs here, for example `- {{file: run1.csv, use: fit}}`{what}")
            return
        for at, row in enumerate(given):
            key = ("runs", at)
            row = self._mapping(row, key, "{file: run1.csv, use: fit, frequency: 10 Hz}")
            file, use = row.get("file"), row.get("use")
            if not isinstance(file, str):
                self.add((*key, "file"), "missing; write for example `file: run1.csv`")
            if use not in [u.value for u in Use]:
                got = f"got {use}" if use is not None else "it is missing"
                self.add((*key, "use"), f"one of fit, holdout belongs here; {got}")
            conditions = {}
            for name, value in row.items():
                if name in ("file", "use") or (own := self._find((*key, name), name)) is None:
                    continue
                p, _ = find_parameter(self.machine, own)
                size = self.read_quantity((*key, name), p, value)
                if size is not None:
                    conditions[own] = size
            if not self.problems:
                taken = [name for name, *_ in self._runs]
                stem = Path(file).stem
                name = stem if stem not in taken else f"{stem}-{at + 1}"
                self._runs.append((name, self._folder / file, Use(use), conditions))
