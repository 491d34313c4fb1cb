"""Configuration of a sensitivity analysis: metrics, parameters, ranges and operating points."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.trusted_code import Trust
from edhas_jax.design.batch.batch import BatchSettings
from edhas_jax.design.batch.design_table import resolve_parameter
from edhas_jax.design.batch.experiment_design import Axis, full_factorial
from edhas_jax.design.gradient.table import parameters_of
from edhas_jax.design.sensitivity.global_sensitivity import MIN_ROWS, MIN_TRAJECTORIES
from edhas_jax.design.task_reader import TaskReader
from edhas_jax.machine.interface.metrics import in_order, metrics_of_batch
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.machine.rigs import Rig

SECTIONS = ("points", "metrics", "local", "ranges", "samples", "trajectories", "seed")
USUAL_METRICS = 3  # that are analysed where a task names none: the leading ones


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
    reader = TaskReader(source, SECTIONS, "ranges", optional=True, trust=trust)
    points = reader.operating_points("points")
    known = metrics_of_batch(reader.machine) if reader.machine is not None and not reader.problems else {}
    metrics = reader.list_section("metrics")
    for i, name in enumerate(metrics):
        if known and name not in known:
            reader.add(("metrics", i), f"no metric `{name}`; {suggest(str(name), known)}")
        if name in metrics[:i]:
            reader.add(("metrics", i), f"{name} is listed twice")
    local = []
    for i, name in enumerate(reader.list_section("local")):
        try:
            local += [resolve_parameter(reader.machine, str(name))[1]] if reader.machine is not None else []
        except ParameterError as error:
            reader.add(("local", i), str(error))
    samples = reader.read_integer(("samples",), reader.data.get("samples", "256"), 0, 2**16)
    if 0 < samples < MIN_ROWS:
        reader.add(("samples",), f"at least {MIN_ROWS} are needed for indices, or 0 to leave them out; got {samples}")
    elif samples & (samples - 1):
        reader.add(("samples",), f"a power of two belongs here (Sobol's sequence needs it), not {samples}")
    trajectories = reader.read_integer(("trajectories",), reader.data.get("trajectories", "20"), 0, 10_000)
    if 0 < trajectories < MIN_TRAJECTORIES:
        reader.add(("trajectories",), f"at least {MIN_TRAJECTORIES} are needed, or 0 for none; got {trajectories}")
    seed = reader.read_integer(("seed",), reader.data.get("seed", "0"), 0, 2**32 - 1)
    for name in sorted({axis.name for axis in points} & {axis.name for axis in reader.axes}):
        reader.add(("ranges", name), "is fixed by the operating points; remove it from one of the two sections")
    reader.finish()
    axes = reader.axes
    default = tuple(in_order(known, lambda name: known[name].rank)[:USUAL_METRICS])
    return SensitivityTask(
        reader.machine, points, tuple(metrics) or default,
        tuple(dict.fromkeys(local)) or tuple(parameters_of(reader.machine)),
        axes, samples if axes else 0, trajectories if axes else 0, seed, reader.settings, reader.name, reader.text,
    )  # fmt: skip
