"""Sweeps as YAML text: a machine, the designs of it that are to be run, and how they are run."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from edhas_jax.batch import BatchError, BatchSettings, plan_chunks
from edhas_jax.config import ConfigError
from edhas_jax.designs import Axis
from edhas_jax.effects import EffectError
from edhas_jax.effects.check import check_effect
from edhas_jax.sweep_reader import SweepReader
from edhas_jax.system import Rig
from edhas_jax.yaml_text import YamlError, dotted, line_of, read_text, read_yaml


@dataclasses.dataclass(frozen=True)
class Sweep:
    """A machine and the designs of it that are to be run: by parameter name a column of SI values."""

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


def load_sweep(path: Path | str) -> Sweep:
    """The sweep in a YAML file; its designs are made, and everything about them is checked.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    path = Path(path)
    text = read_text(path, ConfigError)
    try:
        data, lines, problems = read_yaml(text)
    except YamlError as error:
        what = str(error)
        if "`rig:" in what:  # said of a machine's configuration
            what = "a mapping with the keys `base:` (the configuration of a machine) and `sweep:` is needed"
        raise ConfigError(f"{path}:{error.line}: {what}" if error.line else f"{path}: {what}") from None
    reader = SweepReader(data, path)
    if not isinstance(data.get("sweep"), Mapping) and "rig" in data:
        what = f"describes one machine, not a sweep; name it in a file of its own with `base: {path.name}` and `sweep:`"
        raise ConfigError(f"{path}: {what}")
    read = reader.problems
    if not read and not reader.elsewhere:
        try:
            plan_chunks(reader.machine, reader.designs, reader.settings)
            for effect in reader.machine.effects:
                check_effect(effect, reader.machine, reader.settings.precision.value)
        except (BatchError, EffectError) as error:
            read = [(("base" if "base" in data else "machine",), str(error))]
    problems += [(line_of(lines, key), f"{dotted(key)}: {what}") for key, what in read]
    told = [f"{path}:{line}: {what}" for line, what in sorted(problems, key=lambda p: p[0])]
    if told or reader.elsewhere:
        raise ConfigError("\n".join(dict.fromkeys([*told, *reader.elsewhere])))
    r = reader
    return Sweep(r.machine, r.designs, r.settings, r.kind, r.axes, r.seed, r.name, path)
