"""The comparison of controllers in short form: its errors agree with plain runs, its derivatives with differences."""

from itertools import product

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.simulation.batch_trajectories import simulate_batch
from studies.controllers import comparison as study
from studies.controllers import tuning
from tests.support.headline import headline

KEYS = [("pid", "5khz"), ("cascade", "5khz")]


@pytest.fixture(scope="module")
def findings():
    """Two sampled controllers, tuned by two iterations."""
    budget = study.Budget(candidates=1, starts=1, iterations=2, steps_per_cycle=1250, cycles=2)
    return study.compare_controllers(KEYS, budget, 3)


def test_the_errors_are_those_of_plain_runs_with_the_tuned_gains(findings):
    """At 30 Hz, nominal and with more mass and friction: rms over the last of ten cycles from rest."""
    base = edhas.change(edhas.load(study.CONFIG).machine, load_orifice_area=study.LOAD_ORIFICE_AREA)
    base = structs.replace(base, effects=(*base.effects, study.AmplifierLag(amplifier_time=study.INVERTER_TIME)))
    key = KEYS[0]
    machine = structs.replace(base, controller=study.CONTROLLERS[key[0]][0], sampling=study.SAMPLINGS[key[1]])
    machine = edhas.change(machine, **findings.tuned[key].gains, frequency=30.0)
    changes = study.CONDITIONS["mass and friction"]
    values = {n: np.array([float(edhas.get(machine, n)), v]) for n, v in changes.items()}
    signals = simulate_batch(machine, values, None, 1.0 / 96000, 32, 1000, ("piston_position", "reference")).values
    difference = (signals["piston_position"] - signals["reference"])[-100:]
    rows = [list(study.CONDITIONS).index(condition) for condition in ("nominal", "mass and friction")]
    expected = np.sqrt(np.mean(difference**2, axis=0))
    np.testing.assert_allclose(findings.condition_errors[key][rows, 1], expected, rtol=0.01)


def test_tuning_lowers_the_objective(findings):
    for tuned in findings.tuned.values():
        assert tuned.objective == tuned.history[-1] and np.all(np.diff(tuned.history) <= 0.0)
    # one that begins at the limits of its gains may not improve; whether it does depends on the processor's rounding
    assert max(tuned.history[0] - tuned.history[-1] for tuned in findings.tuned.values()) > 0.01


def test_the_short_form_prints_its_errors_and_draws_them(findings, monkeypatch, tmp_path, capsys):
    def found(keys, budget, points):
        assert keys == KEYS and budget.iterations < study.Budget().iterations
        return findings

    monkeypatch.setattr(study, "compare_controllers", found)
    returned = study.main(["--short", "--out", str(tmp_path)])
    printed = headline(capsys)
    names = ("".join(parts) for parts in product(("pid", "cascade"), ("_10", "_30"), ("", "_disturbed"), ("_5khz",)))
    assert set(printed) == set(returned) == set(names)
    assert float(printed["pid_30_5khz"]) == pytest.approx(1e6 * findings.condition_errors[KEYS[0]][0, 1], rel=5e-3)
    assert (tmp_path / "controllers.png").stat().st_size > 20_000


@pytest.mark.parametrize("sampling", ["continuous", "5khz"])
def test_the_derivatives_of_the_objective(sampling):
    """The derivatives that tuning descends along agree with central differences of the objective."""
    controller, gains = study.CONTROLLERS["cascade"]
    controller = structs.replace(controller, cascade_position_gain=120.0, cascade_velocity_gain=25.0)
    machine = edhas.ActuatorBench(controller=controller, sampling=study.SAMPLINGS[sampling])
    sines, steps = {"frequency": np.array([20.0])}, {"mover_mass": np.array([0.12])}
    task = tuning.TuningTask(machine, sines, study.with_step_inputs(machine), steps)
    budget = tuning.Budget(steps_per_cycle=1000, cycles=6)
    at = np.log([[120.0, 25.0]])
    offset = 1e-5 * np.concatenate([np.eye(2), -np.eye(2)])
    _, slopes = tuning.objective(task, gains, at, budget)
    values, _ = tuning.objective(task, gains, at + offset, budget)
    np.testing.assert_allclose(slopes[0], (values[:2] - values[2:]) / 2e-5, rtol=1e-4)
