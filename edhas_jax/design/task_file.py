"""What the files of sweeps, sizings and sensitivity analyses have in common: machine, batch, parameters that vary."""

import enum
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import yaml

from edhas_jax.config.declared_keys import (
    QUANTITY,
    YES_NO,
    Key,
    Keys,
    by_name,
    by_parameter,
    choice,
    list_of,
    own_value,
    quantity,
    text_value,
    whole_number,
)
from edhas_jax.config.document import Document, Entry
from edhas_jax.config.machine_config import ConfigError, read_config
from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.run_settings import SIMULATION_SETTINGS
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.core.units import format_quantity
from edhas_jax.design.batch.batch import BatchSettings, runs_designs, settings_of_batch
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import MAX_DESIGNS, Axis, DesignError
from edhas_jax.machine.parameters import find_parameter, replace_value
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run_settings import Precision, Simulation

TOLERANCE = Parameter("tolerance", 1e-4, "-", (1e-9, 0.1), "change from cycle to cycle", "", BatchSettings)
SEED = Key(whole_number(0, 2**32 - 1), "of the random numbers", 0)


class Spacing(enum.Enum):
    """How the values of a range are spaced."""

    LINEAR = "linear"
    LOG = "log"


def axis_keys(p: Parameter | None) -> Keys:
    """The keys of a varied parameter: a range, or a list of values."""
    value = own_value(QUANTITY, "a quantity") if p is None else quantity(p)
    return Keys({
        "from": Key(value, "lower end of the range"),
        "to": Key(value, "upper end"),
        "count": Key(whole_number(2, MAX_DESIGNS), "number of values in a grid"),
        "spacing": Key(choice(Spacing, "spacing"), "steps of equal difference or of equal ratio", Spacing.LINEAR),
        "values": Key(own_value(list_of(value).schema, "a list of quantities"), "instead of a range; or only the list"),
    })  # fmt: skip


AXES = own_value(
    {"type": ["object", "null"], "additionalProperties": {"anyOf": [{"type": "array"}, axis_keys(None).schema()]}},
    "by parameter, `{from: 5 um, to: 40 um, count: 20}` or a list",
)
COMMON = {
    "name": Key(text_value(), "title", ""),
    "base": Key(text_value("the file of a machine"), "configuration of the machine, beside this file"),
    "machine": Key(own_value({"type": "object"}, "`{rig: pump_bench}`"), "the machine itself, in place of `base`"),
    "parameters": Key(by_name(own_value(QUANTITY), "{load_orifice_area: 1 mm²}", "parameter"), "changes to it"),
    "batch": Key(Keys({
        "step": Key(quantity(SIMULATION_SETTINGS["step"]), "largest time step", shown="that of the machine"),
        "tolerance": Key(quantity(TOLERANCE), "change from cycle to cycle at which a design is periodic",
                         shown="0.01 %"),
        "max_cycles": Key(whole_number(3, 100_000), "largest number of cycles of a design", shown="16"),
        "soft_start": Key(YES_NO, "the first cycle is a ramp", shown="yes"),
        "precision": Key(choice(Precision, "precision"), "of all numbers; `float32` is faster",
                         shown="that of the machine"),
    }, "{step: 20 us}").kind, "how designs are run"),
}  # fmt: skip


class TaskFile:
    """A file, or a mapping with the same keys, that describes a task on a machine.

    Attributes:
        document: the file; its `finish` raises all problems.
        top: its entry.
        path: the file.
        values: by key what the file has.
        machine: the machine, with the changes under `parameters`; None if it has problems.
        settings: settings of the batch.
    """

    def __init__(self, source: Path | str | Mapping[str, Any], keys: Keys, trust: Trust = ()):
        """Read what is common; problems are collected until `finish`.

        Args:
            source: the YAML file, or a mapping with the same keys and texts, whose machine may be a machine.
            keys: the keys of this kind of task, those of `COMMON` among them.
            trust: the user's code that may run.

        Raises:
            ConfigError: the file cannot be read, or is not YAML.
        """
        own = next(name for name in keys.keys if name not in COMMON)
        self.document = Document(source, ConfigError, f"base: machine.yaml, {own}: …")
        self.top, self.path, self._trust = self.document.top, self.document.path, TrustedCode.of(trust)
        self._base_problems: list[str] = []  # of the base, which name their own file and line
        self.values = keys.read(self.top)
        self.machine, simulation = self._machine()
        self._change_parameters()
        usual = {"precision": simulation.precision}
        usual |= {} if self.machine is None else settings_of_batch(self.machine, simulation)
        stated = {n: v for n, v in self.values["batch"].items() if v is not None}
        self.settings = BatchSettings(**usual | stated)

    def text(self, machine_file: str) -> str:
        """The file; of a mapping its YAML text beside that of the machine, which is `machine_file`."""
        if self.document.text:
            return self.document.text
        rows = {n: v for n, v in self.top.value.items() if n != "machine" and v not in ({}, [], None)}
        return yaml.safe_dump({"base": machine_file} | rows, sort_keys=False, allow_unicode=True)

    @property
    def machine_entry(self) -> Entry:
        """The entry that names the machine."""
        return self.top["base" if "base" in self.top else "machine"]

    @property
    def is_valid(self) -> bool:
        """Whether there are no problems so far."""
        return not (self.top.problems or self._base_problems)

    def _machine(self) -> tuple[Rig | None, Simulation]:
        """The machine of `base` or `machine` and the settings of its runs."""
        base, inline = self.top["base"], self.top["machine"]
        if (base.value is None) == (inline.value is None):
            (inline if base.value else base).add("give either `base: FILE.yaml` or `machine:`, one of them")
        elif isinstance(base.value, str):
            try:
                config = read_config(self.path.parent / base.value, trust=self._trust)
                return config.machine, config.simulation
            except ConfigError as error:
                self._base_problems += str(error).splitlines()
        elif isinstance(inline.value, Rig):
            return inline.value, Simulation()
        elif isinstance(inline.value, Mapping):
            before = len(self.top.problems)
            reader = MachineReader(inline, self.path.parent, trust=self._trust)
            if len(self.top.problems) == before:
                return reader.machine, reader.simulation
        elif base.value is None:
            inline.add(f"a mapping such as `machine: {{rig: pump_bench}}` belongs here, not {yaml_type(inline.value)}")
        return None, Simulation()

    def _change_parameters(self) -> None:
        entries, machine = self.values["parameters"].values(), self.machine
        for entry, p, path in by_parameter(entries, partial(find_parameter, machine)) if machine is not None else ():
            if (number := quantity(p).read(entry)) is not None:
                self.machine = replace_value(self.machine, path, p.name, number)

    def require_batch(self) -> None:
        """Add a problem if the designs of the machine cannot be run."""
        if self.machine is not None and not runs_designs(self.machine):
            self.machine_entry.add(f"a bench that is driven by a sine is needed; this is {self.machine.name}")

    def ranges(self, section: str) -> tuple[Axis, ...]:
        """The parameters of a section that each have a range."""
        axes = read_axes(self.top[section], self.machine, "sobol")
        for axis in axes:
            if axis.values:
                self.top[section][axis.name].add("a range {from: …, to: …} belongs here, not a list")
        return axes

    def operating_points(self, axes: tuple[Axis, ...], section: str) -> tuple[Axis, ...]:
        """The axes of the section `points`; the parameters `axes` of another section may not be among them."""
        points = read_axes(self.top["points"], self.machine, "grid") if self.top["points"].value else ()
        for name in sorted({a.name for a in points} & {a.name for a in axes}):
            self.top[section][name].add("is fixed by the operating points; remove it from one of the two sections")
        return points

    def finish(self) -> None:
        """Raise all problems at once.

        Raises:
            ConfigError: every problem of the file, one line each.
        """
        self.document.finish(self._base_problems)


def read_axes(section: Entry, machine: Rig | None, kind: str) -> tuple[Axis, ...]:
    """The axes of a section that maps parameters to ranges or lists of values.

    Args:
        section: its entry.
        machine: the machine; None after a problem: then only the presence of the section is checked.
        kind: of the sweep, such as "grid".

    Returns:
        The axes; invalid ones become problems.
    """
    if not isinstance(section.value, Mapping) or not section.value:
        example = f"`piston_clearance: {{from: 5 um, to: 40 um{', count: 20' * (kind == 'grid')}}}`"
        section.add(f"at least one parameter belongs here, for example {example}")
        return ()
    if machine is None:
        return ()
    entries = by_parameter(section.mapping("").values(), partial(resolve_parameter, machine))
    axes = [_read_axis(entry, p, column, kind) for entry, p, column in entries]
    return tuple(axis for axis in axes if axis)


def _read_axis(entry: Entry, p: Parameter, column: str, kind: str) -> Axis | None:
    """One axis; None if its keys have problems or contradict each other."""
    problems_before = len(entry.problems)

    def axis(where: Entry, **values) -> Axis | None:
        if len(entry.problems) > problems_before:
            return None
        try:
            return Axis(column, unit=p.unit, **values)
        except DesignError as error:
            return where.add(str(error).partition(": ")[2])

    if isinstance(entry.value, list):
        entry = Entry({"values": entry.value}, entry.key, entry.problems)
    if not isinstance(entry.value, Mapping):
        low, high = (format_quantity(x * p.default or 1.0, p.unit) for x in (0.5, 2.0))
        what = f"for example {{from: {low}, to: {high}}}, not {yaml_type(entry.value)}"
        return entry.add(f"a range or values belong here, {what}")
    keys = axis_keys(p)
    given = keys.read(entry)
    if "values" in entry:
        for name in (n for n in keys.keys if n != "values" and n in entry):
            entry[name].add("given together with `values`; give a range or values")
        listed = entry["values"]
        if not isinstance(listed.value, list) or not listed.value:
            return listed.add("a list of at least one value belongs here")
        return axis(listed, values=tuple(list_of(quantity(p)).read(listed) or ()))
    for name in ("from", "to"):
        if name not in entry:
            return entry.add(f"`{name}` is missing; give `from` and `to`, or `values`")
    if kind == "grid" and "count" not in entry:
        keys.keys["count"].kind.read(entry["count"])
    elif kind != "grid" and "count" in entry:
        entry["count"].add(f"belongs to a grid; a {kind} has one count for all, in `sweep:`")
    is_log = given["spacing"] is Spacing.LOG
    return axis(entry, low=given["from"], high=given["to"], count=given["count"] or 0, log=is_log)
