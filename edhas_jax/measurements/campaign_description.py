"""Parse `campaign.yaml`: the machine, its uncertain parameters, the measured signals and the entries of the runs."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.problem_list import ProblemList, problem_lines
from edhas_jax.config.rig_reader import read_rig
from edhas_jax.config.yaml_with_lines import YamlError, key_text, line_of, parse_yaml, read_text_file, yaml_type
from edhas_jax.core import runtime, structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.effects import Effect, EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import (
    COMPONENT_KINDS,
    ParameterError,
    find_parameter,
    get_parameter,
    list_parameters,
)
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.accuracy import BenchAccuracy
from edhas_jax.measurements.accuracy_reader import AccuracyReader
from edhas_jax.measurements.campaign import CampaignError, Channel, Remark, Severity, Spread, Use, has_parameter
from edhas_jax.measurements.drive_columns import read_drive_columns, recorded_placeholders
from edhas_jax.measurements.record_timing import RecordTiming, read_run_in, read_time, read_timing
from edhas_jax.measurements.run_reader import ColumnSource, RecordFile, RunEntry, TimeSource
from edhas_jax.measurements.sensor_keys import read_sensor_keys
from edhas_jax.measurements.tables.table import Layout
from edhas_jax.measurements.unknown_parameters import read_spread, share_of_nothing
from edhas_jax.simulation.integrator import evaluate_signals

CAMPAIGN_FILE = "campaign.yaml"
DEFAULT_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)  # in the machine unless listed without
KEYS = (
    "name", "rig", "parameters", "effects", "without", "uncertain", "amplifier", "controller", "reference", "time",
    "signals", "drives", "accuracy", "keep", "runs", "decimal", "sheet",
)  # fmt: skip
RUN_KEYS = (
    "file", "files", "use", "start", "window", "running", "uncertain", "time", "columns", "keep", "conditions",
    "decimal", "sheet",
)  # fmt: skip  # of a run, besides its conditions
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


class CampaignDescription(ProblemList):
    """The contents of `campaign.yaml`, valid only if `problems` is empty.

    Args:
        data: the mapping in the file.
        folder: the folder of the file, to which the files of the runs are relative.
        trust: the user's code that may run.

    Attributes:
        name: name of the campaign.
        machine: the machine; None if its description has problems.
        uncertain: how well the parameters that are common to all runs are known.
        own_uncertain: the same of those that have another value in each run.
        channels: the measured signals by name; the noise is NaN where it is not stated.
        accuracy: what is stated about the accuracy of the bench.
        sources: the columns of these signals in the files.
        time: where the time stamps of the files come from.
        recorded: the columns with recorded drives, by drive; the set point of the piston is `reference`.
        run_entries: the entries of the runs.
        remarks: severity, key and sentence of everything that is left out or worth knowing.
    """

    def __init__(self, data: Mapping[str, Any], folder: Path, trust: Trust = ()):
        super().__init__([])
        self.remarks: list[tuple[Severity, tuple, str]] = []
        self._data, self.folder, self._trust = data, folder, trust
        # the name of a folder may be no text in UTF-8
        self.name = str(data.get("name") or folder.resolve().name.encode("utf-8", "replace").decode())
        self.rig = read_rig(data.get("rig"), folder, TrustedCode.of(trust), self.add)
        own = () if self.rig is None else tuple(self.rig.drives)
        self.add_unknown_keys((), data, (*KEYS, *own))
        self.recorded = read_drive_columns(self, data, self.rig)
        self.machine = self._read_machine()
        self.uncertain: dict[str, Spread] = {}
        self.own_uncertain: dict[str, Spread] = {}
        self.channels: dict[str, Channel] = {}
        self.sources: dict[str, ColumnSource] = {}
        self.accuracy = BenchAccuracy()
        self.time = self._read_time()
        self._layout = read_layout(self, (), data)
        self.run_entries: list[RunEntry] = []
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
        """The rig with its parameters, the effects that are listed, and the usual ones except those under `without`."""
        data = self._data
        if self.rig is None:
            return None
        sections = {**self.rig.drives, **COMPONENT_KINDS}
        config = {key: data[key] for key in ("parameters", *sections) if key in data} | {"rig": self.rig}
        for section in ("amplifier", "controller"):
            if isinstance(config.get(section), Mapping):
                kind = config[section].get("kind", "position") if section == "controller" else section
                config[section] = {SHORT_NAMES.get(str(kind), {}).get(n, n): v for n, v in config[section].items()}
        config |= recorded_placeholders(self.recorded)
        available = [effect.id for effect in default_effects(self.rig)]
        without = data.get("without") or []
        if not isinstance(without, list):
            self.add(("without",), f"a list belongs here, for example `[lugre_friction]`, not {yaml_type(without)}")
            without = []
        for k, name in enumerate(without):
            if name not in available:
                self.add(("without", k), f"no refined effect `{name}` of this rig; {suggest(str(name), available)}")
        config["effects"] = listed = data.get("effects")
        if isinstance(listed, list | None):
            more = [name for name in available if name not in [*without, *(listed or [])]]
            config["effects"] = [*(listed or []), *more]  # in this order, so that problems name the listed ones
        for k, name in enumerate(listed if isinstance(listed, list) else []):
            if name in without:
                self.add(("effects", k), f"`{name}` is listed under `without` too")
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
        owners = {p.name: (effect.id, p) for effect in DEFAULT_EFFECTS for p in structs.parameters(effect)}
        present = {effect.id for effect in self.machine.effects}
        given: dict[str, str] = {}
        for name, entry in self._mapping(self._data.get("uncertain"), ("uncertain",), "coil_resistance: 0.02").items():
            key = ("uncertain", name)
            of_run = isinstance(entry, Mapping) and "per" in entry
            if of_run and entry["per"] != "run":
                self.add((*key, "per"), f"only `per: run` is possible here; got {entry['per']}")
            if of_run:
                entry = {k: v for k, v in entry.items() if k != "per"}
            if name in owners and owners[name][0] not in present:
                owner, p = owners[name]
                if (spread := read_spread(self, key, entry, p)) is not None:
                    self.uncertain[name] = spread
                if of_run:
                    self.add(key, f"belongs to {owner}, which the model lacks, so that no run has a value of it")
                sentence = f"belongs to {owner}, which the model lacks; it is used once that effect is added"
                self.remarks.append((Severity.NOTE, key, sentence))
                continue
            canonical = self._canonical_name(key, name)
            if canonical in given:
                self.add(key, f"given twice, also as {given[canonical]}")
            elif canonical is not None:
                value = None if of_run else float(get_parameter(self.machine, canonical))
                spread = read_spread(self, key, entry, find_parameter(self.machine, canonical)[0], value)
                (self.own_uncertain if of_run else self.uncertain)[canonical], given[canonical] = spread, name

    def _read_own_uncertain(self, key: tuple, row: Mapping[str, Any], conditions: Mapping[str, float]):
        """The parameters whose value in a run is an unknown of its own: those of all runs, and those that it names."""
        found = {name: (("uncertain", name), spread) for name, spread in self.own_uncertain.items()}
        for name, entry in self._mapping(row.get("uncertain"), (*key, "uncertain"), "uncertain: {first: 0.5}").items():
            at = (*key, "uncertain", name)
            if (canonical := self._canonical_name(at, name)) is not None:
                found[canonical] = at, read_spread(self, at, entry, find_parameter(self.machine, canonical)[0])
        for name, (at, spread) in found.items():
            value = conditions.get(name, float(get_parameter(self.machine, name)))
            p, _ = find_parameter(self.machine, name)
            if spread is not None and (problem := share_of_nothing(p, value, spread)):
                self.add(at, f"in run {key[-1] + 1} {problem}")
        return {name: spread for name, (_, spread) in found.items()}

    def _read_time(self) -> TimeSource:
        time, start = self._read_time_section(("time",), self._data.get("time"), TimeSource())
        self._timing = RecordTiming(start)
        return time

    def _read_time_section(self, key: tuple, section: Any, usual: TimeSource) -> tuple[TimeSource, float | None]:
        """Where time stamps come from, and the start of the run, of a section `time`; what it lacks is as `usual`."""
        section = self._mapping(section, key, "{column: t, unit: ms}")
        self.add_unknown_keys(key, section, ("column", "unit", "start", "interval", "rate"))
        start = read_time(self, (*key, "start"), section["start"]) if "start" in section else None
        if len({"column", "interval", "rate"} & section.keys()) > 1:
            self.add(key, "either the column of the time stamps, or the interval or rate of the samples belongs here")
        for name, unit, example in (("interval", "s", "50 ms"), ("rate", "Hz", "20 Hz")):
            if name in section:
                size = self._positive_number((*key, name), section[name], unit, example)
                return usual._replace(interval=size if size is None or unit == "s" else 1.0 / size), start
        if not {"column", "unit"} & section.keys():
            return usual, start
        return TimeSource(str(section.get("column", usual.column)), str(section.get("unit", usual.unit))), start

    def _positive_number(self, key: tuple, text: Any, unit: str, example: str) -> float | None:
        """A positive number with its unit, in SI; None, and a problem, for anything else."""
        try:
            value = to_si(str(text), unit, example)
        except UnitError as error:
            self.add(key, str(error))
            return None
        if not value > 0.0:
            self.add(key, f"must be above 0, for example {example}; got {text}")
            return None
        return value

    def _read_files(
        self, key: tuple, row: Mapping[str, Any], time: TimeSource, layout: Layout
    ) -> tuple[RecordFile, ...]:
        """The files of a run: `file: a.csv`, or `files: [a.csv, {file: b.csv, start: 3 s, time: {interval: 1 ms}}]`."""
        if "files" not in row:
            if not isinstance(row.get("file"), str):
                self.add((*key, "file"), "missing; write for example `file: run1.csv`")
                return ()
            return (RecordFile(self.folder / row["file"], time, layout=layout),)
        entries = row["files"]
        if "file" in row or not isinstance(entries, list) or not entries:
            self.add((*key, "files"), "a list belongs here in place of `file`, such as `files: [daq.csv, plc.csv]`")
            return ()
        found = []
        for k, entry in enumerate(entries):
            at = (*key, "files", k)
            entry = {"file": entry} if isinstance(entry, str) else self._mapping(entry, at, "{file: plc.csv}")
            self.add_unknown_keys(at, entry, ("file", "start", "time", "decimal", "sheet"))
            if not isinstance(entry.get("file"), str):
                self.add(at, "the name of a file belongs here, such as `plc.csv` or `{file: plc.csv, start: 3 s}`")
                continue
            of_file, start = self._read_time_section((*at, "time"), entry.get("time"), time)
            start = read_time(self, (*at, "start"), entry["start"]) if "start" in entry else start
            of_layout = read_layout(self, at, entry, layout)
            found.append(RecordFile(self.folder / entry["file"], of_file, start, of_layout))
        return tuple(found)

    def _read_columns(self, key: tuple, section: Any) -> dict[str, ColumnSource]:
        """The columns of signals and drives that have another name in a run, `columns: {pressure: p_2}`."""
        found, usual = {}, self.recorded | self.sources
        for name, entry in self._mapping(section, key, "columns: {pressure: p_2}").items():
            if name not in usual:
                self.add((*key, name), f"is neither a signal nor a recorded drive of the campaign; "
                                       f"{suggest(str(name), usual)}")  # fmt: skip
                continue
            entry = {"column": entry} if isinstance(entry, str) else self._mapping(entry, (*key, name), "{column: p_2}")
            self.add_unknown_keys((*key, name), entry, ("column", "unit"))
            column, unit = entry.get("column", usual[name].column), entry.get("unit", usual[name].unit)
            found[name] = ColumnSource(str(column), str(unit))
        return found

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
            use = row.get("use")
            time, start = self._read_time_section((*key, "time"), row.get("time"), self.time)
            layout = read_layout(self, key, row, self._layout)
            files = self._read_files(key, row, time, layout)
            if use not in [u.value for u in Use]:
                self.add((*key, "use"), f"one of fit, holdout belongs here; got {use or 'nothing'}")
            conditions, given = {}, {}
            of_section = self._mapping(row.get("conditions"), (*key, "conditions"), "conditions: {frequency: 10 Hz}")
            rows = [((*key, name), name, value) for name, value in row.items() if name not in RUN_KEYS]
            rows += [((*key, "conditions", name), name, value) for name, value in of_section.items()]
            for at, name, value in rows:
                if (canonical := self._canonical_name(at, name)) is None:
                    continue
                if canonical in given:
                    self.add(at, f"given twice, also as {given[canonical]}")
                given[canonical] = name
                p, _ = find_parameter(self.machine, canonical)
                if (size := self.read_quantity(at, p, value)) is not None:
                    conditions[canonical] = size
            for name in ("start", "window", "running"):
                if name in row and has_parameter(self.machine, name):
                    other = "; for the time at which the run begins `time: {start: …}`" if name == "start" else ""
                    self.add((*key, name), f"is a parameter of {self.machine.name} and a key of a run; for the "
                                           f"parameter write `conditions: {{{name}: …}}`{other}")  # fmt: skip
            usual = self._timing if start is None else dataclasses.replace(self._timing, start=start)
            timing = read_run_in(self, key, row, read_timing(self, key, row, usual), self.machine, conditions)
            columns = self._read_columns((*key, "columns"), row.get("columns"))
            own = self._read_own_uncertain(key, row, conditions)
            keep = in_all | self._read_keep((*key, "keep"), row)
            if not self.problems:
                names = [entry.name for entry in self.run_entries]
                stem = files[0].path.stem
                name = stem if stem not in names else f"{stem}-{k + 1}"
                self.run_entries.append(RunEntry(name, files, Use(use), conditions, timing, own, columns, keep))
                continue
            for file in files:  # without other problems the run is left out
                if not file.path.is_file():
                    self.add((*key, "file"), f"there is no file {file.path.relative_to(self.folder)}")


def default_effects(rig: type[Rig]) -> list[type[Effect]]:
    """The effects that the machine of a campaign has unless they are listed under `without`."""
    return [] if rig.is_own else [effect for effect in DEFAULT_EFFECTS if set(effect.slots) <= set(rig.slots)]


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
