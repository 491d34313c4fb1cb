"""Sensitivity analysis at every operating point: elasticities, Sobol indices and Morris screening."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pandas as pd

from edhas_jax.config.machine_config import ConfigError
from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import designs_at
from edhas_jax.design.gradient.fixed_point import GradientSettings
from edhas_jax.design.gradient.table import gradient
from edhas_jax.design.sensitivity.config import SensitivityTask
from edhas_jax.design.sensitivity.global_sensitivity import Model, morris_effects, sobol_indices
from edhas_jax.simulation.validity import Status

STEPS_PER_CYCLE = 8192  # elasticities within 0.01, see docs/gradients.md


@dataclasses.dataclass(frozen=True)
class SensitivityResult:
    """The tables of a sensitivity analysis.

    Attributes:
        points: a row per operating point (SI); without columns it is the machine as configured.
        local: elasticities, as `Gradient.frame`.
        sobol: Sobol indices with a column `point`; None if left out.
        morris: elementary effects with a column `point`; None if left out.
    """

    points: pd.DataFrame
    local: pd.DataFrame
    sobol: pd.DataFrame | None = None
    morris: pd.DataFrame | None = None


def analyse_sensitivity(
    task: SensitivityTask, on_progress: Callable[[str, float], None] | None = None
) -> SensitivityResult:
    """Run a sensitivity analysis.

    Args:
        task: metrics, parameters, ranges and operating points.
        on_progress: called with the name of a stage and the share done.

    Returns:
        The tables of all methods.

    Raises:
        ConfigError: too many designs fail for statistics.
    """
    report = on_progress or (lambda stage, share: None)
    columns = task.operating_points()
    points = pd.DataFrame(columns, index=range(len(next(iter(columns.values()))) if columns else 1))
    settings = GradientSettings(steps_per_cycle=STEPS_PER_CYCLE, run=task.settings)
    local = gradient(task.machine, task.metrics, task.local, columns or None, settings,
                     on_cycle=lambda share: report("elasticities", share)).frame  # fmt: skip
    tables: dict[str, pd.DataFrame] = {}
    names = [axis.name for axis in task.ranges]
    methods = ("sobol", sobol_indices, task.samples), ("morris", morris_effects, task.trajectories)
    for kind, method, size in (row for row in methods if row[-1]):
        by_point = []
        for k, point in points.iterrows():
            model = _model_at(task, point, lambda share, k=k, kind=kind: report(kind, (k + share) / len(points)))
            try:
                by_point.append(method(model, names, task.metrics, size, task.seed).assign(point=k))
            except ValueError as error:
                raise ConfigError(f"{task.name or 'sensitivity'}: at operating point {k + 1}: {error}") from None
        tables[kind] = pd.concat(by_point, ignore_index=True)
    return SensitivityResult(points, local, **tables)


def _model_at(task: SensitivityTask, point: pd.Series, on_progress: Callable[[float], None]) -> Model:
    """The metrics at an operating point as a function of the fractions of the ranges."""

    def model(fractions: np.ndarray) -> np.ndarray:
        designs = designs_at(task.ranges, fractions)
        designs |= {n: np.full(len(fractions), value) for n, value in point.items()}
        results = run_designs(task.machine, designs, task.settings, lambda done, total: on_progress(done / total))
        values = np.stack([results[m] for m in task.metrics], axis=1)
        return np.where((results["status"] == Status.OK)[:, None], values, np.nan)

    return model
