"""Configuration of a sweep: a YAML file with a machine, the designs to run, and the settings of the batch."""

import dataclasses
import enum
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from edhas_jax.config.declared_keys import Key, Keys, choice, text_value, whole_number
from edhas_jax.config.machine_config import ConfigError
from edhas_jax.core.trusted_code import Trust
from edhas_jax.design.batch.batch import BatchError, BatchSettings, plan_chunks
from edhas_jax.design.batch.design_table import read_design_table
from edhas_jax.design.batch.experiment_design import (
    MAX_DESIGNS,
    Axis,
    DesignError,
    full_factorial,
    latin_hypercube,
    sobol_sequence,
)
from edhas_jax.design.task_file import AXES, COMMON, SEED, TaskFile, read_axes
from edhas_jax.machine.effects import EffectError
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.rigs import Rig


class SweepKind(enum.Enum):
    """How the designs of a sweep are chosen."""

    GRID = "grid"
    LATIN_HYPERCUBE = "latin_hypercube"
    SOBOL = "sobol"
    TABLE = "table"


OF_SAMPLES = ("kind", "count", "seed", "parameters")
KEYS_OF_KIND = {
    SweepKind.GRID: ("kind", "parameters"), SweepKind.LATIN_HYPERCUBE: OF_SAMPLES, SweepKind.SOBOL: OF_SAMPLES,
    SweepKind.TABLE: ("kind", "file"),
}  # fmt: skip
SWEEP_KEYS = Keys({
    "kind": Key(choice(SweepKind, "kind of sweep"), "how the designs are chosen", needed=True),
    "count": Key(whole_number(1, MAX_DESIGNS), "number of designs of a sample", needed=True),
    "seed": SEED,
    "parameters": Key(AXES, "what varies"),
    "file": Key(text_value(example="designs.csv"), "a table: a column `name [unit]` per parameter, a row per "
                "design, no missing values", needed=True),
}, "{kind: grid, parameters: {…}}", of_kind=KEYS_OF_KIND)  # fmt: skip
KEYS = Keys(COMMON | {"sweep": Key(SWEEP_KEYS.kind, "which designs are simulated", needed=True)})


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
    file = TaskFile(Path(path), KEYS, trust)
    if not isinstance(file.top["sweep"].value, Mapping) and "rig" in file.top:
        remedy = f"name it in a file of its own with `base: {file.path.name}` and `sweep:`"
        raise ConfigError(f"{path}: describes one machine, not a sweep; {remedy}")
    if file.top["sweep"].value is None:
        kinds = ", ".join(kind.value for kind in SweepKind)
        file.top["sweep"].add(f"missing; a mapping with `kind:`, one of {kinds}")
    section, kind = file.values["sweep"], file.values["sweep"]["kind"]
    is_sampled = kind not in (None, SweepKind.TABLE)
    axes = read_axes(section["parameters"], file.machine, kind.value) if is_sampled else ()
    designs = _designs(file, axes)
    if file.is_valid:
        try:
            plan_chunks(file.machine, designs, file.settings)
            for effect in file.machine.effects:
                check_effect(effect, file.machine, file.settings.precision.value)
        except (BatchError, EffectError) as error:
            file.machine_entry.add(str(error))
    file.finish()
    seed = section["seed"] if KEYS_OF_KIND[kind] == OF_SAMPLES else None
    return Sweep(file.machine, designs, file.settings, kind.value, axes, seed, file.values["name"], file.path)


def _designs(file: TaskFile, axes: tuple[Axis, ...]) -> dict[str, np.ndarray] | None:
    """The designs of a file, or over axes; None after a problem."""
    section, kind = file.values["sweep"], file.values["sweep"]["kind"]
    is_table = kind is SweepKind.TABLE
    if file.machine is None or kind is None or (section["file"] is None if is_table else not file.is_valid):
        return None
    try:
        if is_table:
            return read_design_table(file.path.parent / section["file"], file.machine)
        if kind is SweepKind.GRID:
            return full_factorial(axes)
        sample = latin_hypercube if kind is SweepKind.LATIN_HYPERCUBE else sobol_sequence
        return sample(axes, section["count"], section["seed"])
    except DesignError as error:
        return file.top["sweep"]["file" if is_table else "parameters"].add(str(error))
