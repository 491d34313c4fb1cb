"""Parse `campaign.yaml`: the machine, its uncertain parameters, the measured signals and the entries of the runs."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.problem_list import ProblemList, problem_lines
from edhas_jax.config.rig_reader import read_rig
from edhas_jax.config.yaml_with_lines import YamlError, key_text, line_of, parse_yaml, read_text_file, yaml_type
from edhas_jax.core import runtime, structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.effects import EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import COMPONENT_KINDS, ParameterError, find_parameter, list_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.accuracy import BenchAccuracy
from edhas_jax.measurements.accuracy_reader import AccuracyReader
from edhas_jax.measurements.campaign import CampaignError, Channel, Remark, Severity, Use
from edhas_jax.measurements.drive_columns import read_drive_columns, recorded_placeholders
from edhas_jax.measurements.record_timing import RecordTiming, read_run_in, read_time, read_timing
from edhas_jax.measurements.run_reader import ColumnSource
from edhas_jax.measurements.sensor_keys import read_sensor_keys
from edhas_jax.measurements.tables.table import Layout
from edhas_jax.simulation.integrator import evaluate_signals

CAMPAIGN_FILE = "campaign.yaml"
DEFAULT_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)  # in the machine unless listed without
KEYS = (
    "name", "rig", "parameters", "effects", "without", "uncertain", "amplifier", "controller", "reference", "time",
    "signals", "drives", "accuracy", "keep", "runs", "decimal", "sheet",
)  # fmt: skip
RUN_KEYS = ("file", "use", "start", "window", "running", "keep", "decimal", "sheet")  # of a run, besides its conditions
# short names of parameters by section or kind of controller
SHORT_NAMES = {
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


class RunEntry(NamedTuple):
    """An entry under `runs`: name of the run, its file, its use, its conditions by parameter (SI), timing, layout."""

    name: str
    file: Path
    use: Use
    conditions: dict[str, float]
    timing: RecordTiming
    layout: Layout = Layout()


class CampaignDescription(ProblemList):
    """The contents of `campaign.yaml`, valid only if `problems` is empty.

    Args:
        data: the mapping in the file.
        folder: the folder of the file, to which the files of the runs are relative.
        trust: the user's code that may run.

    Attributes:
        name: name of the campaign.
        machine: the machine; None if its description has problems.
        uncertain: relative standard deviations by parameter.
        channels: the measured signals by name; the noise is NaN where it is not stated.
        accuracy: what is stated about the accuracy of the bench.
        sources: the columns of these signals in the files.
        time: the column of the time stamps.
        recorded: the columns with recorded drives, by drive; the set point of the piston is `reference`.
        run_entries: the entries of the runs.
        keep: by name of a run, the signals of which no sample is left out by the checks.
        remarks: severity, key and sentence of everything that is left out or worth knowing.
    """

    def __init__(self, data: Mapping[str, Any], folder: Path, trust: Trust = ()):
        super().__init__([])
        self.remarks: list[tuple[Severity, tuple, str]] = []
        self._data, self.folder, self._trust = data, folder, trust
        # the name of a folder may be no text in UTF-8
        self.name = str(data.get("name") or folder.resolve().name.encode("utf-8", "replace").decode())
        self.rig = read_rig(data.get("rig"), folder, TrustedCode.of(trust), self.add)
        own = () if self.rig is None or not self.rig.is_own else tuple(self.rig.drives)
        self.add_unknown_keys((), data, (*KEYS, *own))
        self.recorded = read_drive_columns(self, data, self.rig)
        self.machine = self._read_machine()
        self.uncertain: dict[str, float] = {}
        self.channels: dict[str, Channel] = {}
        self.sources: dict[str, ColumnSource] = {}
        self.accuracy = BenchAccuracy()
        self.time = self._read_time()
        self._layout = read_layout(self, (), data)
        self.run_entries: list[RunEntry] = []
        self.keep: dict[str, frozenset[str]] = {}
        if self.machine is not None:
            self._read_uncertain()
            self._read_signals()
            reader = AccuracyReader(self, self.channels, self.machine.signals, self._canonical_name, self.recorded)
            self.accuracy = reader.read(data.get("accuracy"))
            self._read_runs()

    def _mapping(self, value: Any, key: tuple, example: str) -> Mapping[str, Any]:
        if value is None or isinstance(value, Mapping):
            return value or {}
        self.add(key, f"a mapping belongs here, for example `{example}`, not {yaml_type(value)}")
        return {}

    def _read_machine(self) -> Rig | None:
        """The rig with its parameters and all default effects except those listed under `without`."""
        data = self._data
        if self.rig is None:
            return None
        sections = self.rig.drives if self.rig.is_own else COMPONENT_KINDS
        config = {key: data[key] for key in ("parameters", *sections) if key in data} | {"rig": self.rig}
        for section in ("amplifier", "controller"):
            if isinstance(config.get(section), Mapping):
                kind = config[section].get("kind", "position") if section == "controller" else section
                config[section] = {SHORT_NAMES.get(str(kind), {}).get(n, n): v for n, v in config[section].items()}
        config |= recorded_placeholders(self.recorded)
        slots = set(self.rig.slots)
        usual = () if self.rig.is_own else DEFAULT_EFFECTS
        available = [effect.id for effect in usual if set(effect.slots) <= slots]
        without = data.get("without") or []
        if not isinstance(without, list):
            self.add(("without",), f"a list belongs here, for example `[lugre_friction]`, not {yaml_type(without)}")
            without = []
        for k, name in enumerate(without):
            if name not in available:
                self.add(("without", k), f"no refined effect `{name}` of this rig; {suggest(str(name), available)}")
        config["effects"] = [name for name in available if name not in without]
        if self.rig.is_own:
            config["effects"] = data.get("effects")
        reader = MachineReader(config, self.folder, (), self._trust)
        self.problems += reader.problems
        return None if self.problems else reader.machine

    def _canonical_name(self, key: tuple, name: str) -> str | None:
        """The name of a parameter of the machine: without its path where that is unique; None if there is none."""
        try:
            p, path = find_parameter(self.machine, "target.step_size" if name == "target" else name)
        except ParameterError as error:
            self.add(key, str(error))
            return None
        is_unique = sum(q.name == p.name for q, _, _ in list_parameters(self.machine)) == 1
        return p.name if is_unique else f"{path}.{p.name}"

    def _read_uncertain(self) -> None:
        owners = {p.name: effect.id for effect in DEFAULT_EFFECTS for p in structs.parameters(effect)}
        present = {effect.id for effect in self.machine.effects}
        given: dict[str, str] = {}
        for name, text in self._mapping(self._data.get("uncertain"), ("uncertain",), "coil_resistance: 0.02").items():
            key = ("uncertain", name)
            spread = self._positive_number(key, text, "-", "0.1")
            if spread is None:
                continue
            if name in owners and owners[name] not in present:
                self.uncertain[name] = spread
                sentence = f"belongs to {owners[name]}, which the model lacks; it is used once that effect is added"
                self.remarks.append((Severity.NOTE, key, sentence))
            elif (canonical := self._canonical_name(key, name)) in given:
                self.add(key, f"given twice, also as {given[canonical]}")
            elif canonical is not None:
                self.uncertain[canonical], given[canonical] = spread, name

    def _positive_number(self, key: tuple, text: Any, unit: str, example: str) -> float | None:
        """A positive number with or without its unit, in SI; None, and a problem, for anything else."""
        try:
            value = to_si(str(text), unit, example)
        except UnitError as error:
            self.add(key, str(error))
            return None
        if not (value > 0.0 and math.isfinite(value)):
            self.add(key, f"must be above 0, for example {example}; got {text}")
            return None
        return value

    def _read_time(self) -> ColumnSource:
        section = self._mapping(self._data.get("time"), ("time",), "{column: t, unit: ms}")
        self.add_unknown_keys(("time",), section, ("column", "unit", "start"))
        at = "time", "start"
        self._timing = RecordTiming(read_time(self, at, section["start"]) if "start" in section else None)
        return ColumnSource(str(section.get("column", "time")), str(section.get("unit", "")))

    def _read_signals(self) -> None:
        section = self._mapping(self._data.get("signals"), ("signals",), "current: {unit: A, noise: 0.02}")
        if not section:
            self.add(("signals",), "missing; name the measured signals, such as `current: {unit: A, noise: 0.02}`")
        signals = runtime.eval_shape(lambda m: evaluate_signals(m, m.initial_state(), 0.0, 1.0), self.machine)
        available = signals.keys() - {"time"}
        for name, value in section.items():
            key = ("signals", name)
            entry = {"unit": value} if isinstance(value, str) else self._mapping(value, key, "{unit: A, noise: 0.02}")
            self.add_unknown_keys(key, entry, ("unit", "noise", "column", "model_error", "limits"))
            if name not in available:
                known = name in SIGNALS or name in self.machine.signals
                problem = f"{self.machine.name} has no such signal" if known else "unknown signal"
                self._leave_out(key, f"{problem}; {suggest(str(name), available)}")
                continue
            try:
                unit, about = str(entry.get("unit") or ""), self.machine.signals[name]
                size = to_si(f"1 {unit}", about.unit, f"1 {about.display_unit}") - to_si(f"0 {unit}", about.unit)
            except UnitError as error:
                self._leave_out((*key, "unit"), str(error))
                continue
            noise = self._read_noise(entry)
            if noise is None:
                sentence = f"the standard deviation of the sensor noise in {unit or 'its unit'} must be above 0"
                self._leave_out((*key, "noise"), f"{sentence}; got {entry['noise']}")
                continue
            more = read_sensor_keys(self, key, entry, about, size)
            self.channels[name] = Channel(unit, noise * size, **more)
            self.sources[name] = ColumnSource(str(entry.get("column", name)), unit)

    def all_problems(self) -> list[tuple[tuple, str]]:
        """The problems; with the signals that are left out, if there are any or if no signal remains."""
        left_out = [(key, sentence) for _, key, sentence in self.remarks if key[0] == "signals"]
        return self.problems + left_out if self.problems or not self.channels else []

    def _read_noise(self, entry: Mapping[str, Any]) -> float | None:
        """The stated noise in the unit of the signal; NaN if none is stated, None if it is not a positive number."""
        if entry.get("noise") is None:
            return math.nan
        try:
            noise = float(str(entry["noise"]))
        except ValueError:
            return None
        return noise if 0.0 < noise < math.inf else None

    def _leave_out(self, key: tuple, problem: str) -> None:
        self.remarks.append((Severity.ERROR, key, f"{problem}; the signal is left out"))

    def _read_keep(self, key: tuple, section: Mapping[str, Any]) -> frozenset[str]:
        """The signals of `keep: [pressure]` or `keep: all`."""
        names = section.get("keep", [])
        if names == "all":
            return frozenset(self.channels)
        if not isinstance(names, list) or not set(map(str, names)) <= self.channels.keys():
            self.add(key, f"`all` or a list of signals ({', '.join(self.channels)}) belongs here; got {names}")
            return frozenset()
        return frozenset(names)

    def _read_runs(self) -> None:
        section = self._data.get("runs")
        if not isinstance(section, list) or not section:
            found = f", not {yaml_type(section)}" if section is not None else ""
            self.add(("runs",), f"a list belongs here, for example `- {{file: run1.csv, use: fit}}`{found}")
            return
        in_all = self._read_keep(("keep",), self._data)
        for k, row in enumerate(section):
            key = ("runs", k)
            row = self._mapping(row, key, "{file: run1.csv, use: fit, frequency: 10 Hz}")
            file, use = row.get("file"), row.get("use")
            if not isinstance(file, str):
                self.add((*key, "file"), "missing; write for example `file: run1.csv`")
            if use not in [u.value for u in Use]:
                self.add((*key, "use"), f"one of fit, holdout belongs here; got {use or 'nothing'}")
            conditions, given = {}, {}
            for name, value in row.items():
                if name in RUN_KEYS or (canonical := self._canonical_name((*key, name), name)) is None:
                    continue
                if canonical in given:
                    self.add((*key, name), f"given twice, also as {given[canonical]}")
                given[canonical] = name
                p, _ = find_parameter(self.machine, canonical)
                if (size := self.read_quantity((*key, name), p, value)) is not None:
                    conditions[canonical] = size
            keep = in_all | self._read_keep((*key, "keep"), row)
            layout = read_layout(self, key, row, self._layout)
            timing = read_run_in(self, key, row, read_timing(self, key, row, self._timing), self.machine, conditions)
            if not self.problems:
                names = [entry.name for entry in self.run_entries]
                stem = Path(file).stem
                name = stem if stem not in names else f"{stem}-{k + 1}"
                self.keep[name] = keep
                self.run_entries.append(RunEntry(name, self.folder / file, Use(use), conditions, timing, layout))
            elif isinstance(file, str) and not (self.folder / file).is_file():
                self.add((*key, "file"), f"there is no file {file}")  # without other problems the run is left out


def read_layout(problems: ProblemList, key: tuple, row: Mapping[str, Any], default: Layout = Layout()) -> Layout:
    """Read `decimal` and `sheet` of an entry under `runs`, or of the campaign.

    Args:
        problems: collects what is wrong.
        key: the key of the entry.
        row: the entry.
        default: what holds where it does not state its own.
    """
    decimal = row.get("decimal", default.decimal)
    if decimal not in ("", ".", ","):
        problems.add((*key, "decimal"), f'what stands before the decimals belongs here, "." or ","; got {decimal}')
    return Layout(str(decimal), str(row.get("sheet", default.sheet)))


def read_description(
    path: Path,
    description: type[CampaignDescription] = CampaignDescription,
    trust: Trust = (),
) -> tuple[CampaignDescription, list[Remark]]:
    """Read a `campaign.yaml`.

    Args:
        path: the file.
        description: the class to read it with.
        trust: the user's code that may run.

    Returns:
        The description, and its remarks with the lines that they refer to.

    Raises:
        CampaignError: the file cannot be read, or is wrong (every problem, one line each).
    """
    try:
        data, lines, problems = parse_yaml(read_text_file(path, CampaignError))
    except YamlError as error:
        raise CampaignError(f"{path}:{error.line}: {error}" if error.line else f"{path}: {error}") from None
    found = description(data, path.parent, trust)
    problems += [(line_of(lines, key), f"{key_text(key)}: {sentence}") for key, sentence in found.all_problems()]
    if problems:
        problems.sort(key=lambda problem: problem[0])
        raise CampaignError(problem_lines(f"{path}:{line}: {sentence}" for line, sentence in problems))
    remarks = [
        Remark(severity, path, line_of(lines, key), f"{key_text(key)}: {sentence}")
        for severity, key, sentence in found.remarks
    ]
    return found, remarks
