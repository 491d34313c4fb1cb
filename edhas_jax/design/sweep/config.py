"""Configuration of a sweep: a YAML file with a machine, the designs to run, and the settings of the batch."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.machine_config import ConfigError, read_config
from edhas_jax.config.machine_reader import MachineReader
from edhas_jax.config.problem_list import ProblemList, problem_lines
from edhas_jax.config.run_settings import SIMULATION_SETTINGS
from edhas_jax.config.yaml_with_lines import (
    KeyPath,
    YamlError,
    key_text,
    line_of,
    parse_yaml,
    read_text_file,
    yaml_type,
)
from edhas_jax.core.structs import Parameter
from edhas_jax.core.trusted_code import Trust, TrustedCode
from edhas_jax.design.batch.batch import BatchError, BatchSettings, plan_chunks, settings_of_batch
from edhas_jax.design.batch.design_table import read_design_table
from edhas_jax.design.batch.experiment_design import (
    MAX_DESIGNS,
    Axis,
    DesignError,
    full_factorial,
    latin_hypercube,
    sobol_sequence,
)
from edhas_jax.design.sweep.axes_reader import AxesReader
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.parameters import ParameterError, find_parameter, replace_value
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.run_settings import Precision, Simulation

SECTIONS = ("name", "base", "machine", "parameters", "sweep", "batch")
SWEEP_KEYS = {
    "grid": ("kind", "parameters"),
    "latin_hypercube": ("kind", "count", "seed", "parameters"),
    "sobol": ("kind", "count", "seed", "parameters"),
    "table": ("kind", "file"),
}
BATCH_QUANTITIES = {
    "step": SIMULATION_SETTINGS["step"],
    "tolerance": Parameter("tolerance", 1e-4, "-", (1e-9, 0.1), "change from cycle to cycle", "", BatchSettings),
}
MAX_CYCLES_SPAN = 3, 100_000


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A machine and the designs of it that are to be run.

    Attributes:
        machine: the machine on which all designs are based.
        designs: by parameter a column of values (SI), shape (designs,).
        settings: step, tolerance and limits of the batch.
        kind: "grid", "latin_hypercube", "sobol" or "table".
        axes: ranges or values of the parameters; empty for a table.
        seed: of the samples; None for a grid or a table.
        name: title of the sweep.
        path: its configuration file.
    """

    machine: Rig
    designs: Mapping[str, np.ndarray]
    settings: BatchSettings = BatchSettings()
    kind: str = "table"
    axes: tuple[Axis, ...] = ()
    seed: int | None = None
    name: str = ""
    path: Path | None = None

    def __len__(self) -> int:
        return len(next(iter(self.designs.values())))


def load_sweep(path: Path | str, trust: Trust = ()) -> Sweep:
    """Read a sweep from a YAML file, generate its designs, and check them.

    Args:
        path: the configuration file.
        trust: Python files (or modules) of your own that may run if the machine names them, besides those that were
            allowed by `edhas trust`.

    Returns:
        The sweep, ready to run.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    path = Path(path)
    text = read_text_file(path, ConfigError)
    try:
        data, lines, problems = parse_yaml(text)
    except YamlError as error:
        what = str(error)
        if "`rig:" in what:  # the message for a file that should describe a machine
            what = "a mapping with the keys `base:` (the configuration of a machine) and `sweep:` is needed"
        raise ConfigError(f"{path}:{error.line}: {what}" if error.line else f"{path}: {what}") from None
    reader = SweepReader(data, path, TrustedCode.of(trust))
    if not isinstance(data.get("sweep"), Mapping) and "rig" in data:
        what = f"describes one machine, not a sweep; name it in a file of its own with `base: {path.name}` and `sweep:`"
        raise ConfigError(f"{path}: {what}")
    found = reader.problems
    if not found and not reader.base_problems:
        try:
            plan_chunks(reader.machine, reader.designs, reader.settings)
            for effect in reader.machine.effects:
                check_effect(effect, reader.machine, reader.settings.precision.value)
        except (BatchError, EffectError) as error:
            found = [(("base" if "base" in data else "machine",), str(error))]
    problems += [(line_of(lines, key), f"{key_text(key)}: {what}") for key, what in found]
    messages = [f"{path}:{line}: {what}" for line, what in sorted(problems, key=lambda p: p[0])]
    if messages or reader.base_problems:
        raise ConfigError(problem_lines([*messages, *reader.base_problems]))
    return Sweep(
        reader.machine, reader.designs, reader.settings, reader.kind, reader.axes, reader.seed, reader.name, path
    )


class SweepReader(ProblemList):
    """Reads the mapping of a sweep in one pass; its attributes are valid only if there are no problems.

    Attributes:
        base_problems: problems of the base configuration, which name their own file and line.
        name: title of the sweep.
        machine: the machine, with the changes under `parameters:`; None if it has problems.
        settings: settings of the batch.
        kind: kind of the sweep.
        axes: the parameters that are varied.
        seed: of the samples.
        designs: by parameter a column of values (SI); None if they cannot be generated.
    """

    def __init__(self, data: Mapping[str, Any], path: Path, trust: TrustedCode):
        super().__init__([])
        self.base_problems: list[str] = []
        self._data, self._path, self._trust = data, path, trust
        self._given: dict[tuple[str, str], str] = {}  # names of the parameters changed so far
        self.add_unknown_keys((), data, SECTIONS)
        name = data.get("name") or ""
        self.name = str(name)
        if not isinstance(name, str):
            self.add(("name",), f"a text belongs here, not {yaml_type(name)}")
        self.machine, self._simulation = None, Simulation()
        self._read_machine()
        self.settings = self._read_settings()
        self.kind, self.axes, self.seed = "", (), None
        self.designs = self._read_designs()

    def _read_machine(self) -> None:
        """The machine of `base:` or `machine:`, changed by `parameters:`."""
        base, inline = self._data.get("base"), self._data.get("machine")
        if (base is None) == (inline is None):
            self.add(("machine",) if base else ("base",), "give either `base: FILE.yaml` or `machine:`, one of them")
        elif base is not None:
            if not isinstance(base, str):
                return self.add(("base",), f"the file of a machine belongs here, not {yaml_type(base)}")
            try:
                config = read_config(self._path.parent / base, trust=self._trust)
                self.machine, self._simulation = config.machine, config.simulation
            except ConfigError as error:
                self.base_problems += str(error).splitlines()
        elif isinstance(inline, Rig):
            self.machine = inline
        elif not isinstance(inline, Mapping):
            self.add(("machine",), f"a mapping such as `machine: {{rig: pump_bench}}` belongs here, not "
                                    f"{yaml_type(inline)}")  # fmt: skip
        else:
            reader = MachineReader(inline, self._path.parent, (), self._trust)
            self.problems += [(("machine", *key), what) for key, what in reader.problems]
            if not reader.problems:
                self.machine, self._simulation = reader.machine, reader.simulation
        for name, value in (self._section("parameters", "{load_orifice_area: 1 mm²}") or {}).items():
            if self.machine is not None:
                self.machine = self._changed(self.machine, ("parameters", name), name, value)

    def _changed(self, machine: Rig, key: KeyPath, name: str, value: Any) -> Rig:
        """The machine with another value of a parameter; unchanged if the name or the value is invalid."""
        try:
            p, path = find_parameter(machine, name)
        except ParameterError as error:
            self.add(key, str(error))
            return machine
        if (path, p.name) in self._given:
            self.add(key, f"given twice, also as {self._given[path, p.name]}")
        self._given[path, p.name] = name
        number = self.read_quantity(key, p, value)
        return machine if number is None else replace_value(machine, path, p.name, number)

    def _read_settings(self) -> BatchSettings:
        """The section `batch:`; step and precision default to those of the base."""
        base = self._simulation
        values = {"precision": base.precision} if self.machine is None else settings_of_batch(self.machine, base)
        section = self._section("batch", "{step: 20 us}") or {}
        self.add_unknown_keys(("batch",), section, (*BATCH_QUANTITIES, "max_cycles", "soft_start", "precision"))
        for name, value in section.items():
            if name == "precision":
                valid = [p.value for p in Precision]
                if value in valid:
                    values[name] = Precision(value)
                else:
                    self.add(("batch", name), f"no precision `{value}`; one of {', '.join(valid)}")
            elif name == "soft_start":
                if isinstance(value, bool):
                    values[name] = value
                else:
                    self.add(("batch", name), f"yes or no belongs here, not {yaml_type(value)}")
            elif name == "max_cycles":
                values[name] = self.read_integer(("batch", name), value, *MAX_CYCLES_SPAN)
            elif name in BATCH_QUANTITIES:
                number = self.read_quantity(("batch", name), BATCH_QUANTITIES[name], value)
                if number is not None:
                    values[name] = number
        return BatchSettings(**values)

    def _section(self, name: str, example: str) -> Mapping[str, Any] | None:
        value = self._data.get(name)
        if value is None or isinstance(value, Mapping):
            return value
        self.add((name,), f"a mapping belongs here, for example `{name}: {example}`, not {yaml_type(value)}")
        return None

    def _read_designs(self) -> dict[str, np.ndarray] | None:
        section = self._section("sweep", "{kind: grid, parameters: {…}}")
        if section is None:
            if self._data.get("sweep") is None:
                self.add(("sweep",), f"missing; a mapping with `kind:`, one of {', '.join(SWEEP_KEYS)}")
            return None
        kind = section.get("kind")
        if not isinstance(kind, str) or kind not in SWEEP_KEYS:
            what = "missing" if kind is None else f"no kind `{kind}` of sweep"
            return self.add(("sweep", "kind"), f"{what}; one of {', '.join(SWEEP_KEYS)}")
        self.kind = kind
        self.add_unknown_keys(("sweep",), section, SWEEP_KEYS[kind])
        if kind == "table":
            return self._read_table(section.get("file"))
        count = 0
        if kind != "grid":
            count = self.read_integer(("sweep", "count"), section.get("count"), 1, MAX_DESIGNS)
            self.seed = self.read_integer(("sweep", "seed"), section.get("seed", "0"), 0, 2**32 - 1)
        self.axes = AxesReader(self.machine, kind, self.problems).read(section.get("parameters"))
        if self.problems or self.base_problems or self.machine is None:
            return None
        try:
            if kind == "grid":
                return full_factorial(self.axes)
            sample = latin_hypercube if kind == "latin_hypercube" else sobol_sequence
            return sample(self.axes, count, self.seed)
        except DesignError as error:
            return self.add(("sweep", "parameters"), str(error))

    def _read_table(self, file: Any) -> dict[str, np.ndarray] | None:
        if not isinstance(file, str):
            return self.add(("sweep", "file"), "missing; write for example `file: designs.csv`")
        if self.machine is None:
            return None
        try:
            return read_design_table(self._path.parent / file, self.machine)
        except DesignError as error:
            return self.add(("sweep", "file"), str(error))
