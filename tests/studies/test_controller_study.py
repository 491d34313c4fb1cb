"""The study of controllers in short form: it runs through, its picture is drawn, its derivatives are right."""

from itertools import product

import numpy as np
import pytest

from edhas_jax.core import structs
from studies.controllers import comparison as study


def test_short(tmp_path):
    found = study.main(["--short", "--out", str(tmp_path)])
    what = product(("pid", "antsmc"), ("_10", "_30"), ("", "_disturbed"), ("_5khz",))
    assert set(found) == {"".join(parts) for parts in what}
    assert (tmp_path / "controllers.png").stat().st_size > 20_000
    assert all(np.isfinite(v) and 0.0 < v < 2500.0 for v in found.values())


@pytest.mark.parametrize("sampling", ["continuous", "5khz"])
def test_the_derivatives_of_the_objective(sampling):
    """By central differences: what tuning descends along is the slope of what it lowers."""
    from studies.controllers import tuning

    controller, gains = study.CONTROLLERS["cascade"]
    controller = structs.replace(controller, cascade_position_gain=120.0, cascade_velocity_gain=25.0)
    machine = study.edhas.ActuatorBench(controller=controller, sampling=study.SAMPLINGS[sampling])
    sines, steps = {"frequency": np.array([20.0])}, {"mover_mass": np.array([0.12])}
    task = tuning.Task(machine, sines, study.with_steps(machine), steps)
    budget = tuning.Budget(steps_per_cycle=1000, cycles=6)
    at = np.log([[120.0, 25.0]])
    nudge = 1e-5 * np.concatenate([np.eye(2), -np.eye(2)])
    _, slopes = tuning.objective(task, gains, at, budget)
    values, _ = tuning.objective(task, gains, at + nudge, budget)
    np.testing.assert_allclose(slopes[0], (values[:2] - values[2:]) / 2e-5, rtol=1e-4)
