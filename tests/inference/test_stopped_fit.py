"""A fit that is stopped keeps its best point and says so; its steps tell cost and values while it runs."""

import json
import signal

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.commands.interruption import STATUS_INTERRUPTED
from edhas_jax.commands.progress import VARIABLE
from edhas_jax.inference.fit import fit as fit_module
from edhas_jax.inference.fit.calibration import STOPPED
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem, gauss_newton_model
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.measurement_model import EvaluationPoint
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}


@pytest.fixture(scope="module")
def campaign():
    return checked_campaign(measured(empty_campaign(lengths=(201, 201, 201)), edhas.change(bench(), **TRUTH)))


def interrupt_after(count, steps):
    def note(step):
        steps.append(step)
        if len(steps) == count:
            raise KeyboardInterrupt

    return note


@pytest.mark.parametrize("count", [1, 3])
def test_the_best_point_is_kept_and_the_result_says_that_it_was_stopped(campaign, count):
    steps = []
    result = edhas.fit(campaign, starts=2, on_step=interrupt_after(count, steps))
    assert len(steps) == count and result.interrupted and result.fit.stopped and not result.fit.converged
    assert result.fit.values == steps[-1].values
    assert result.findings()[0] == STOPPED and STOPPED in str(result.summary())
    errors = result.rms_residuals()
    assert errors["calibrated"]["fit"]["overall"] < errors["before"]["fit"]["overall"]
    assert np.isfinite(result.fit.std).all()


def test_an_interruption_before_the_first_point_keeps_nothing(campaign, monkeypatch):
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(fit_module, "gauss_newton_model", interrupted)
    with pytest.raises(KeyboardInterrupt):
        edhas.fit(campaign, starts=2)


def test_a_fit_within_other_work_passes_the_interruption_on(campaign):
    problem = FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign))
    with pytest.raises(KeyboardInterrupt):
        fit(problem, starts=2, on_step=interrupt_after(2, []))


def test_steps_tell_the_lowest_cost_and_where_it_is(campaign):
    steps = []
    problem = FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign))
    found = fit(problem, starts=2, on_step=steps.append)
    assert not found.stopped and {step.search for step in steps} <= {"rough search", "fine search"}
    for name in {step.search for step in steps}:
        costs = [step.cost for step in steps if step.search == name]
        assert costs == sorted(costs, reverse=True)
    last = steps[-1]
    x = np.array([u.coordinate(last.values[u.name]) for u in problem.unknowns])
    case = EvaluationPoint(x, tuple(range(len(problem.model().runs))))
    assert gauss_newton_model(problem, [case], found.resolution.fine).cost[0] == pytest.approx(last.cost, rel=1e-9)
    assert found.cost == last.cost


@pytest.fixture
def interruptible():
    """SIGINT as at a terminal: a process in the background of a shell begins with it ignored."""
    former = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, former)


def test_the_command_keeps_the_result_and_tells_its_steps(interruptible, campaign, tmp_path, monkeypatch, capsys):
    folder, out, told = tmp_path / "bench", tmp_path / "fitted", tmp_path / "progress"
    write_campaign(measured(empty_campaign(lengths=(201, 201, 201)), edhas.change(bench(), **TRUTH)), folder)
    monkeypatch.setenv(VARIABLE, str(told))
    original = fit_module._correct_discretisation

    def interrupted(*arguments):
        monkeypatch.setattr(fit_module, "_correct_discretisation", original)
        signal.raise_signal(signal.SIGINT)
        return original(*arguments)

    monkeypatch.setattr(fit_module, "_correct_discretisation", interrupted)
    status = main(["fit", str(folder), "--out", str(out), "--quiet"])
    written = json.loads((out / "fit.json").read_text())
    assert written["stopped"] and written["findings"][0] == STOPPED and (out / "config.yaml").is_file()
    rows = [json.loads(line) for line in told.read_text().splitlines()]
    steps = [row["numbers"] for row in rows if "numbers" in row]
    assert steps and steps[-1]["values"] == {n: row["value"] for n, row in written["calibrated"].items()}
    assert status == STATUS_INTERRUPTED and not capsys.readouterr().out
