"""Configuration of a sensitivity analysis: metrics, parameters, ranges and operating points."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.config.declared_keys import Key, Keys, list_of, own_value, whole_number
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, full_factorial
from edhas_jax.design.gradient.table import parameters_of
from edhas_jax.design.sensitivity.global_sensitivity import MIN_ROWS, MIN_TRAJECTORIES
from edhas_jax.design.task_file import AXES, COMMON, SEED, TaskFile
from edhas_jax.machine.interface.metrics import in_order, metrics_of_batch
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig

USUAL_METRICS = 3  # that are analysed where a task names none: the leading ones
NAMES = list_of(own_value({"type": "string"}))
KEYS = Keys(COMMON | {
    "points": Key(AXES, "every combination is an operating point"),
    "metrics": Key(NAMES, "the outputs", (), shown="the leading three, of a pump flow, power and efficiency"),
    "local": Key(NAMES, "parameters whose elasticities are calculated", (), shown="all"),
    "ranges": Key(AXES, "`{from, to, spacing}` of the parameters of the global analysis"),
    "samples": Key(whole_number(0, 2**16), "rows of Sobol's method, a power of two; 0 leaves it out", 256),
    "trajectories": Key(whole_number(0, 10_000), "of Morris's method; 0 leaves it out", 20),
    "seed": SEED,
})  # fmt: skip


@dataclasses.dataclass(frozen=True)
class SensitivityTask:
    """A sensitivity analysis.

    Attributes:
        machine: the machine.
        points: axes that span a grid of operating points.
        metrics: the outputs.
        local: parameters whose elasticities are computed.
        ranges: parameters of the global analysis with their ranges; empty without one.
        samples: rows of Sobol's method, a power of two; 0 leaves it out.
        trajectories: of Morris's method; 0 leaves it out.
        seed: of the samples.
        settings: settings of the batch.
        name: title of the analysis.
        text: the configuration file.
    """

    machine: Rig
    points: tuple[Axis, ...]
    metrics: tuple[str, ...]
    local: tuple[str, ...]
    ranges: tuple[Axis, ...]
    samples: int = 256
    trajectories: int = 20
    seed: int = 0
    settings: BatchSettings = BatchSettings()
    name: str = ""
    text: str = ""

    def operating_points(self) -> dict[str, np.ndarray]:
        """The columns (SI) of the operating points, shape (points,) each; empty for the machine as it is."""
        return full_factorial(self.points) if self.points else {}


def load_sensitivity(source: Path | str | Mapping[str, Any], trust: Trust = ()) -> SensitivityTask:
    """Read a sensitivity analysis from a YAML file.

    Args:
        source: the configuration file, or a mapping with the same keys, whose machine may be a machine.
        trust: Python files (or modules) of your own that may run if the file names them, besides those that were
            allowed by `edhas trust`.

    Returns:
        The task; without a section `ranges` it has no global analysis.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    file = TaskFile(source, KEYS, trust)
    file.require_batch()
    values, machine = file.values, file.machine
    axes = file.ranges("ranges") if "ranges" in file.top else ()
    known = metrics_of_batch(machine) if machine is not None else {}
    points = file.operating_points(axes, "ranges")
    metrics = [entry.value for entry in values["metrics"]]
    for i, entry in enumerate(values["metrics"]):
        if known and str(entry.value) not in known:
            entry.add(f"no metric `{entry.value}`; {suggest(str(entry.value), known)}")
        if entry.value in metrics[:i]:
            entry.add(f"{entry.value} is listed twice")
    local = {}
    for entry in values["local"] if machine is not None else ():
        try:
            local[resolve_parameter(machine, str(entry.value))[1]] = None
        except ParameterError as error:
            entry.add(str(error))
    samples, trajectories = values["samples"], values["trajectories"]
    if 0 < samples < MIN_ROWS:
        file.top["samples"].add(f"at least {MIN_ROWS} are needed for indices, or 0 to leave them out; got {samples}")
    elif samples & (samples - 1):
        file.top["samples"].add(f"a power of two belongs here (Sobol's sequence needs it), not {samples}")
    if 0 < trajectories < MIN_TRAJECTORIES:
        file.top["trajectories"].add(f"at least {MIN_TRAJECTORIES} are needed, or 0 for none; got {trajectories}")
    file.finish()
    default = tuple(in_order(known, lambda name: known[name].rank)[:USUAL_METRICS])
    return SensitivityTask(
        machine, points, tuple(metrics) or default, tuple(local) or tuple(parameters_of(machine)), axes,
        samples if axes else 0, trajectories if axes else 0, values["seed"], file.settings, values["name"],
        file.text("machine.yaml"),
    )  # fmt: skip
