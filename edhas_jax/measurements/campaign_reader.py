"""Read a campaign: a folder with `campaign.yaml` and the files of its runs.

The description names the machine, its uncertain parameters, the measured signals and the entries of the runs.
"""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.declared_keys import by_parameter, quantity
from edhas_jax.config.document import Document, Entry
from edhas_jax.config.machine_keys import USUAL_EFFECTS, machine_keys
from edhas_jax.config.machine_reader import MachineReader, read_rig
from edhas_jax.config.recorded_signal import encode_samples
from edhas_jax.config.tables.table import Layout
from edhas_jax.config.yaml_with_lines import key_text
from edhas_jax.core import structs
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.remark import Remark, Severity
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import UnitError, difference_to_si, to_si
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.interface.signals import SIGNALS, Signal
from edhas_jax.machine.parameters import find_parameter, get_parameter, has_parameter, short_names
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.accuracy import BenchAccuracy, RecorderClock, SensorAccuracy
from edhas_jax.measurements.campaign import CAMPAIGN_FILE, Campaign, CampaignError, Channel, Spread, brief_lines
from edhas_jax.measurements.campaign_keys import CLOCK, DRIVE_COLUMN, FILE, campaign_keys, sensor_keys
from edhas_jax.measurements.checks.unit_checks import limits_remarks
from edhas_jax.measurements.record_timing import RecordTiming, running_before
from edhas_jax.measurements.run_reader import ColumnSource, RecordFile, RunEntry, RunReader, TimeSource
from edhas_jax.measurements.unknown_parameters import read_spread, share_of_nothing
from edhas_jax.simulation.integrator import signal_names

Values = Mapping[str, Any]  # what `Keys.read` has read of an entry


class CampaignDescription:
    """The contents of `campaign.yaml`, valid only if it has no problems.

    Args:
        top: the mapping in the file; what is wrong is added to its problems.
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
        remarks: severity, entry and sentence of everything that is left out or worth knowing.
    """

    def __init__(self, top: Entry, folder: Path, trust: Trust = ()):
        self.remarks: list[tuple[Severity, Entry, str]] = []
        self._top, self.folder, self._trust = top, folder, TrustedCode.of(trust)
        self.rig = read_rig(top["rig"], folder, self._trust)
        values = campaign_keys(self.rig or Rig).read(top)
        # the name of a folder may be no text in UTF-8
        self.name = values["name"] or folder.resolve().name.encode("utf-8", "replace").decode()
        self.recorded = self._drive_columns()
        self.machine = self._read_machine()
        self.uncertain: dict[str, Spread] = {}
        self.own_uncertain: dict[str, Spread] = {}
        self.channels: dict[str, Channel] = {}
        self.sources: dict[str, ColumnSource] = {}
        self.accuracy = BenchAccuracy()
        self.time = _time_source(top, {"time": values["time"]}, TimeSource())  # a drive may be called `start`
        self._layout = _layout(top, values, Layout())
        self.run_entries: list[RunEntry] = []
        if self.machine is not None:
            self._read_uncertain(values["uncertain"])
            self._read_signals(values["signals"])
            self.accuracy = self._read_accuracy(top["accuracy"], values["accuracy"])
            self._in_all = self._read_keep(top["keep"])
            for entry, row in zip(top["runs"].list(), values["runs"] or (), strict=False):
                self._read_run(entry, row)
            if not top["runs"].value:
                top["runs"].add("a list belongs here, for example `- {file: run1.csv, use: fit}`")

    def _drive_columns(self) -> dict[str, ColumnSource]:
        """The columns of the recorded drives, by drive; that of the set point is `reference`."""
        rig, reference = self.rig or Rig, self._top["reference"]
        has_reference = hasattr(rig, "reference") or self.rig is None
        entries = self._top["drives"].mapping("{voltage: u}") if self.rig is not None else {}
        for name in [n for n in entries if n not in rig.drives]:
            hint = f"the recorded set point of {rig.name} is `reference: COLUMN`" if has_reference else ""
            entries.pop(name).add(f"unknown key; {hint or suggest(str(name), rig.drives)}")
        names_column = "column" in reference and not {"kind", "file"} & set(reference.value)
        if has_reference and (isinstance(reference.value, str) or names_column):
            entries["reference"] = reference
        found = {name: DRIVE_COLUMN.read(entry) for name, entry in entries.items()}
        return {n: ColumnSource(v["column"] or n, v["unit"] or "", v["between"]) for n, v in found.items()}

    def _read_machine(self) -> Rig | None:
        """The rig with its parameters, the effects that are listed, and the usual ones except those under `without`."""
        if self.rig is None:
            return None
        names = machine_keys(self.rig).keys.keys() - {"name", "simulation"}
        config = {name: value for name, value in self._top.value.items() if name in names}
        config |= {"rig": self.rig, "without": config.get("without")}
        placeholder = {"kind": "recorded", **encode_samples(Recorded(values=np.zeros(2), interval=1.0))}
        config |= dict.fromkeys(self.recorded, placeholder)
        before = len(self._top.problems)
        reader = MachineReader(Entry(config, (), self._top.problems), self.folder, trust=self._trust)
        return reader.machine if len(self._top.problems) == before else None

    def _find(self, name: str) -> tuple[Parameter, str]:
        """A parameter of the machine, and its name: without its path where that is unique."""
        p, path = find_parameter(self.machine, "target.step_size" if name == "target" else name)
        return p, short_names(self.machine)[path, p.name]

    def _read_uncertain(self, entries: Mapping[str, Entry]) -> None:
        owners = {p.name: (effect.id, p) for effect in USUAL_EFFECTS for p in structs.parameters(effect)}
        present = {effect.id for effect in self.machine.effects}
        stated = {name: _without_per(entry) for name, entry in entries.items()}
        for name in [n for n in stated if n in owners and owners[n][0] not in present]:
            (owner, p), entry = owners[name], stated.pop(name)
            if (spread := read_spread(entry, p)) is not None:
                self.uncertain[name] = spread
            if "per" in entries[name]:
                entry.add(f"belongs to {owner}, which the model lacks, so that no run has a value of it")
            sentence = f"belongs to {owner}, which the model lacks; it is used once that effect is added"
            self.remarks.append((Severity.NOTE, entry, sentence))
        for entry, p, name in by_parameter(stated.values(), self._find):
            of_run = "per" in entries[entry.key[-1]]
            value = None if of_run else float(get_parameter(self.machine, name))
            (self.own_uncertain if of_run else self.uncertain)[name] = read_spread(entry, p, value)

    def _read_own_uncertain(
        self, run: int, entries: Mapping[str, Entry], conditions: Mapping[str, float]
    ) -> dict[str, Spread | None]:
        """The parameters whose value in a run is an unknown of its own: those of all runs, and those that it names."""
        found = {name: (self._top["uncertain"][name], spread) for name, spread in self.own_uncertain.items()}
        found |= {name: (entry, read_spread(entry, p)) for entry, p, name in by_parameter(entries.values(), self._find)}
        for name, (entry, spread) in found.items():
            value = conditions.get(name, float(get_parameter(self.machine, name)))
            p, _ = find_parameter(self.machine, name)
            if spread is not None and (problem := share_of_nothing(p, value, spread)):
                entry.add(f"in run {run} {problem}")
        return {name: spread for name, (_, spread) in found.items()}

    def _read_signals(self, signals: Mapping[str, Values]) -> None:
        if not signals:
            self._top["signals"].add("missing; name the measured signals, such as `current: {unit: A, noise: 0.02}`")
        declared = self.machine.signals
        available = signal_names(self.machine)
        for name, values in signals.items():
            entry, unit = self._top["signals"][name], values["unit"]
            if name not in available or name == "time":
                is_known = name in SIGNALS or name in declared
                problem = f"{self.machine.name} has no such signal" if is_known else "unknown signal"
                self._leave_out(entry, f"{problem}; {suggest(str(name), set(available) - {'time'})}")
                continue
            try:
                about = declared[name]
                scale = difference_to_si(f"1 {unit}", about.unit, f"1 {about.display_unit}")
            except UnitError as error:
                self._leave_out(entry["unit"], str(error))
                continue
            noise = _number(values["noise"], math.nan)
            if not 0.0 < noise < math.inf and values["noise"].value is not None:
                sentence = f"the standard deviation of the sensor noise in {unit or 'its unit'} must be above 0"
                self._leave_out(entry["noise"], f"{sentence}; got {entry['noise'].value}")
                continue
            error = _number(values["model_error"], 0.0)
            if not 0.0 <= error < math.inf:
                sentence = "a standard deviation in the unit of the signal belongs here, such as 0.1"
                entry["model_error"].add(f"{sentence}; got {entry['model_error'].value}")
            limits = _limits(values["limits"], about)
            self.channels[name] = Channel(unit, noise * scale, model_error=error * scale, limits=limits)
            self.sources[name] = ColumnSource(values["column"] or name, unit)

    def problems_of_signals(self) -> None:
        """Make problems of the signals that are left out, if there are other problems or no signal remains."""
        if self._top.problems or not self.channels:
            for _, entry, sentence in self.remarks:
                if entry.key[0] == "signals":
                    entry.add(sentence)

    def _leave_out(self, entry: Entry, problem: str) -> None:
        self.remarks.append((Severity.ERROR, entry, f"{problem}; the signal is left out"))

    def _read_keep(self, entry: Entry) -> frozenset[str]:
        """The signals of `keep: [pressure]` or `keep: all`."""
        names = [] if entry.value is None else entry.value
        if names == "all":
            return frozenset(self.channels)
        if not isinstance(names, list) or not set(map(str, names)) <= self.channels.keys():
            entry.add(f"`all` or a list of signals ({', '.join(self.channels)}) belongs here; got {names}")
            return frozenset()
        return frozenset(names)

    def _read_accuracy(self, section: Entry, values: Values) -> BenchAccuracy:
        """The section `accuracy`, completed by what only the campaign knows."""
        entries = section["settings"].mapping("").values()
        settings = {name: values["settings"][e.key[-1]] for e, _, name in by_parameter(entries, self._find)}
        sensors: dict[str, SensorAccuracy] = {}
        for name, entry in values["signals"].items():
            if name not in self.channels:
                entry.add(f"is not measured in this campaign; {suggest(str(name), self.channels)}")
                continue
            keys = sensor_keys(self.machine.signals[name].unit, f"0.1 {self.channels[name].unit}")
            sensors[name] = SensorAccuracy(**keys.read(entry))
        clocks = self._read_clocks(section["clocks"], values["clocks"])
        own = {name: values[name] for name in ("trigger", "recorder_filter", "clock_error")}
        return BenchAccuracy(settings=settings, signals=sensors, clocks=clocks, **own)

    def _read_clocks(self, section: Entry, clocks: Mapping[str, Values]) -> dict[str, RecorderClock]:
        """Further recorders, `motor: {channels: [speed, current], shift: 0.2 s}`."""
        found, taken, recorded = {}, set(), (*self.channels, *self.recorded)
        for name, values in clocks.items():
            entry, names = section[name], values["channels"]
            if not names or "shift" not in entry:
                entry.add(f"channels and shift belong here, for example {CLOCK.example}")
                continue
            for channel in names:
                if channel not in recorded:
                    entry["channels"].add(f"{channel} is not recorded; {suggest(str(channel), recorded)}")
                elif channel in taken:
                    entry["channels"].add(f"{channel} has two clocks")
                taken.add(channel)
            found[str(name)] = RecorderClock(tuple(names), values["shift"])
        return found

    def _read_run(self, entry: Entry, values: Values) -> None:
        """Read an entry under `runs`; one without problems is added to the entries."""
        time, layout = _time_source(entry, values, self.time), _layout(entry, values, self._layout)
        files = self._read_files(entry, time, layout)
        conditions = self._read_conditions(entry, values)
        timing = self._read_timing(entry, values, conditions)
        columns = self._read_columns(entry["columns"], values["columns"])
        own = self._read_own_uncertain(entry.key[-1] + 1, values["uncertain"], conditions)
        keep = self._in_all | self._read_keep(entry["keep"])
        if not entry.problems:
            names = [entry.name for entry in self.run_entries]
            stem = files[0].path.stem
            name = stem if stem not in names else f"{stem}-{entry.key[-1] + 1}"
            self.run_entries.append(RunEntry(name, files, values["use"], conditions, timing, own, columns, keep))
            return
        for file in files:  # without other problems the run is left out
            if not file.path.is_file():
                entry["file"].add(f"there is no file {file.path.relative_to(self.folder)}")

    def _read_conditions(self, entry: Entry, values: Values) -> dict[str, float]:
        """The parameters of the machine (SI) that a run sets."""
        entries = [entry[name] for name in entry.value or {} if name not in values]
        entries += values["conditions"].values()
        found = {name: quantity(p).read(inside) for inside, p, name in by_parameter(entries, self._find)}
        for name in ("start", "window", "running"):
            if name in entry and has_parameter(self.machine, name):
                other = "; for the time at which the run begins `time: {start: …}`" if name == "start" else ""
                what = f"is a parameter of {self.machine.name} and a key of a run"
                entry[name].add(f"{what}; for the parameter write `conditions: {{{name}: …}}`{other}")
        return {name: value for name, value in found.items() if value is not None}

    def _read_timing(self, entry: Entry, values: Values, conditions: Mapping[str, float]) -> RecordTiming:
        """The part of the record of a run that is used, and how long the machine has been running before it."""
        low, high = values["window"]["from"] or 0.0, values["window"]["to"]
        high, run_in = math.inf if high is None else high, 0.0
        if not 0.0 <= low < high:
            entry["window"].add("`from` must be 0 s or later, and `to` later than `from`")
        if values["running"] and self.machine.cycle is None:
            entry["running"].add("needs a bench that is driven by a sine: only its cycles say what came before")
        elif values["running"]:
            run_in = running_before(self.machine, conditions)
        return RecordTiming(window=(low, high), run_in=run_in)

    def _read_files(self, entry: Entry, time: TimeSource, layout: Layout) -> tuple[RecordFile, ...]:
        """The files of a run: `file: a.csv`, or `files: [a.csv, {file: b.csv, start: 3 s, time: {interval: 1 ms}}]`."""
        file, files = entry["file"], entry["files"]
        if "files" not in entry:
            if isinstance(file.value, str):
                return (RecordFile(self.folder / file.value, time, layout),)
            file.add("missing; write for example `file: run1.csv`")
            return ()
        if "file" in entry or not isinstance(files.value, list) or not files.value:
            files.add("a list belongs here in place of `file`, such as `files: [daq.csv, plc.csv]`")
            return ()
        found = []
        for inside in files.list():
            values = FILE.read(inside)
            of_file, of_layout = _time_source(inside, values, time), _layout(inside, values, layout)
            if values["file"] is not None:
                found.append(RecordFile(self.folder / values["file"], of_file, of_layout))
        return tuple(found)

    def _read_columns(self, section: Entry, columns: Mapping[str, Values]) -> dict[str, ColumnSource]:
        """The columns that are named differently in the file of this run, `columns: {pressure: p_2}`, by signal."""
        found, usual = {}, self.recorded | self.sources
        for name, values in columns.items():
            if name in usual:
                column, unit = values["column"] or usual[name].column, values["unit"] or usual[name].unit
                found[name] = ColumnSource(column, unit)
            else:
                hint = suggest(str(name), usual)
                section[name].add(f"is neither a signal nor a recorded drive of the campaign; {hint}")
        return found


def _without_per(entry: Entry) -> Entry:
    """An entry of `uncertain` without its `per: run`."""
    if "per" not in entry:
        return entry
    if entry["per"].value != "run":
        entry["per"].add(f"only `per: run` is possible here; got {entry['per'].value}")
    return Entry({k: v for k, v in entry.value.items() if k != "per"}, entry.key, entry.problems)


def _time_source(entry: Entry, values: Values, usual: TimeSource) -> TimeSource:
    """Where time stamps come from by `time` and `start` of an entry; what these lack is as `usual`."""
    section, given = entry["time"], values["time"]
    if sum(name in section for name in ("column", "interval", "rate")) > 1:
        section.add("either the column of the time stamps, or the interval or rate of the samples belongs here")
    start = next((s for s in (values.get("start"), given["start"], usual.start) if s is not None), None)
    interval = given["interval"] or (1.0 / given["rate"] if given["rate"] else None)
    if interval is not None or given["column"] is given["unit"] is None:
        return usual._replace(interval=interval or usual.interval, start=start)
    return TimeSource(given["column"] or usual.column, given["unit"] or usual.unit, start=start)


def _layout(entry: Entry, values: Values, default: Layout) -> Layout:
    """What an entry states about files; what it does not is as in `default`."""
    decimal = entry["decimal"].value if "decimal" in entry else default.decimal
    if decimal not in ("", ".", ","):
        entry["decimal"].add(f'what stands before the decimals belongs here, "." or ","; got {decimal}')
    return Layout(str(decimal), default.sheet if values["sheet"] is None else values["sheet"])


def _limits(entry: Entry, about: Signal) -> tuple[float, float]:
    """The ends (SI) of `limits: [0 V, 10 V]`; infinite without."""
    low, high = -math.inf, math.inf
    try:
        if entry.value is not None:
            low, high = (to_si(str(end), about.unit, f"1 {about.display_unit}") for end in entry.value)
    except (UnitError, TypeError, ValueError) as error:
        entry.add(f"both ends of the sensor's range belong here, such as [0 V, 10 V]: {error}")
    if not low < high:
        entry.add("the first end must be below the second")
    return low, high


def _number(entry: Entry, default: float) -> float:
    """A plain number; the default if it is missing, −1 for anything else."""
    try:
        return default if entry.value is None else float(str(entry.value))
    except ValueError:
        return -1.0


def read_description(
    path: Path, description: type[CampaignDescription] = CampaignDescription, trust: Trust = ()
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
    document = Document(path, CampaignError, "rig: pump_bench, signals: …, runs: …")
    found = description(document.top, path.parent, trust)
    found.problems_of_signals()
    document.finish()
    remarks = [
        Remark(severity, path, document.line(entry.key), f"{key_text(entry.key)}: {sentence}")
        for severity, entry, sentence in found.remarks
    ]
    return found, remarks


def read_campaign(path: Path | str, trust: Trust = (), planned: bool = False) -> Campaign:
    """Read a campaign.

    Args:
        path: its folder, or its `campaign.yaml`.
        trust: Python files (or modules) of your own that may run if the campaign names them, besides those that were
            allowed by `edhas trust`.
        planned: whether the files of the runs may hold recorded drives alone, without any measured signal.

    Returns:
        The campaign in SI units. `Campaign.remarks` lists the data that are left out, and those that look wrong.

    Raises:
        CampaignError: `campaign.yaml` is wrong (every problem, one line each), or no run can be used.
    """
    path = Path(path)
    path = path / CAMPAIGN_FILE if path.is_dir() else path
    description, remarks = read_description(path, trust=trust)
    reader = RunReader(description.machine, description.sources, description.recorded, planned)
    runs = [run for entry in description.run_entries for run in reader.read(entry)]
    remarks = (*remarks, *reader.remarks)
    if not runs:
        raise CampaignError("\n".join([*brief_lines(remarks), f"{path}: no run can be used"]))
    machine = description.machine
    if runs[0].recordings:
        machine = structs.replace(machine, **runs[0].recordings)
    campaign = Campaign(
        description.name, path.parent, machine, description.uncertain, description.channels, tuple(runs), remarks,
        stated_accuracy=description.accuracy, file=path,
    )  # fmt: skip
    return dataclasses.replace(campaign, remarks=(*remarks, *limits_remarks(campaign)))


def as_campaign(source: Campaign | Path | str, trust: Trust = ()) -> Campaign:
    """A campaign, or the one in a folder; errors as of `read_campaign`."""
    return source if isinstance(source, Campaign) else read_campaign(source, trust)
