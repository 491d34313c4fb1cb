"""Configurations of sensitivity analyses."""

import dataclasses
from pathlib import Path

import numpy as np

from edhas_jax.batch import BatchSettings
from edhas_jax.designs import Axis, grid, own_name
from edhas_jax.gradient_table import metrics_of, parameters_of
from edhas_jax.parameters import ParameterError
from edhas_jax.signals import nearest
from edhas_jax.system import Rig
from edhas_jax.task_reader import TaskReader

SECTIONS = ("points", "metrics", "local", "ranges", "samples", "trajectories", "seed")
DEFAULT_METRICS = ("mean_flow", "mean_electrical_power", "overall_efficiency")


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """What is to be found out: which parameters act on which metrics, at which operating points.

    `local` are the parameters of the elasticities; `ranges` those of the global analysis, `samples` of Sobol's and
    `trajectories` of Morris's method (0: left out, as without ranges). `points` span a grid of operating points.
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
        """The columns (SI) of the operating points; none: the machine as it stands."""
        return grid(self.points) if self.points else {}


def load_sensitivity(path: Path | str) -> Sensitivity:
    """The analysis in a YAML file.

    Raises:
        ConfigError: every problem of the file, one line each.
    """
    reader = TaskReader(path, SECTIONS, "ranges", optional=True)
    points = reader.points("points")
    known = metrics_of(reader.machine) if reader.machine is not None and not reader.problems else []
    metrics = reader.listed("metrics")
    for i, name in enumerate(metrics):
        if known and name not in known:
            reader.add(("metrics", i), f"no metric `{name}`; {nearest(str(name), known)}")
    local = []
    for i, name in enumerate(reader.listed("local")):
        try:
            local += [own_name(reader.machine, str(name))[1]] if reader.machine is not None else []
        except ParameterError as error:
            reader.add(("local", i), str(error))
    samples = reader.whole(("samples",), reader.data.get("samples", "256"), 0, 2**16)
    if samples & (samples - 1):
        reader.add(("samples",), f"a power of two belongs here (Sobol's sequence needs it), not {samples}")
    trajectories = reader.whole(("trajectories",), reader.data.get("trajectories", "20"), 0, 10_000)
    seed = reader.whole(("seed",), reader.data.get("seed", "0"), 0, 2**32 - 1)
    both = {axis.name for axis in points} & {axis.name for axis in reader.axes}
    for name in sorted(both):
        reader.add(("ranges", name), "is held at the operating points; leave it out here or there")
    reader.finish()
    axes = reader.axes
    default = tuple(n for n in DEFAULT_METRICS if n in known) or tuple(known[:3])
    return Sensitivity(
        reader.machine, points, tuple(metrics) or default,
        tuple(dict.fromkeys(local)) or tuple(parameters_of(reader.machine)),
        axes, samples if axes else 0, trajectories if axes else 0, seed, reader.settings, reader.name, reader.text,
    )  # fmt: skip
