"""Calibration on synthetic campaigns: estimates, standard errors, priors, sensors, drift, profiles, result folder."""

import dataclasses
import json

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import read_config
from edhas_jax.diagnosis.report.calibration_report import fit_report
from edhas_jax.inference.fit.calibration import Calibration, campaign_residuals, save_calibration
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitError, FitProblem, quadratic_model_at
from edhas_jax.inference.fit.uncertainty import fit_each_run, profile_likelihood
from edhas_jax.machine.parameters import ParameterError, get_parameter
from edhas_jax.measurements.campaign import Spread, Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import EvaluationPoint, MeasurementModel
from edhas_jax.measurements.residuals import rms_by_signal, rms_over_noise
from edhas_jax.measurements.sensor_models import SensorLag, SensorOffset
from edhas_jax.measurements.time_resolution import choose_time_resolution
from edhas_jax.measurements.unknown_parameters import (
    ParameterScale,
    UnknownParameter,
    uncertain_unknowns,
    unknown_around,
)
from tests.support.synthetic_campaign import CONDITIONS, PER_SAMPLE, bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}


def problem_of(campaign, **more):
    return FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign), **more)


@pytest.fixture(scope="module")
def campaign():
    return measured(empty_campaign(), edhas.change(bench(), **TRUTH))


@pytest.fixture(scope="module")
def found(campaign):
    return fit(problem_of(campaign), starts=3)


def test_true_values_lie_within_three_standard_errors(found):
    assert found.converged
    for name, value in TRUTH.items():
        low, high = found.interval(name, 3.0)
        assert low < value < high, name
        assert found.standard_errors[name] < 0.01 * value


def test_residuals_of_all_runs_are_noise_after_the_fit(campaign, found):
    after = campaign_residuals(campaign, found.machine, found.instruments, PER_SAMPLE)
    for use in Use:
        assert all(value == pytest.approx(1.0, abs=0.12) for value in rms_by_signal(campaign, after, use).values())
    before = campaign_residuals(campaign, campaign.machine, Instruments(), PER_SAMPLE)
    assert rms_over_noise(before["run3"].values()) > 1.4


def test_derivatives_of_the_signals_match_finite_differences(campaign):
    unknowns = uncertain_unknowns(campaign)
    chains = Instruments({"current": (SensorLag(lag_time=1e-3), SensorOffset(offset=0.1))})
    lag = UnknownParameter("current.sensor_lag.lag_time", 1e-3, 0.5, "s", (1e-5, 1.0))
    offset = UnknownParameter("current.sensor_offset.offset", 0.0, 0.2, "A", (-5.0, 5.0), ParameterScale.LINEAR)
    model = MeasurementModel(campaign, campaign.machine, (*unknowns, lag, offset), campaign.runs, chains)
    x = np.array([0.3, -0.5, 0.2, 0.1, 0.4, -0.3])
    (at,) = model.predict([EvaluationPoint(x, (1,))], PER_SAMPLE, with_sensitivities=True)
    e = 1e-4
    for k in range(len(x)):
        moved = [x + sign * e * np.eye(len(x))[k] for sign in (1.0, -1.0)]
        points = [EvaluationPoint(m, (1,)) for m in moved]
        ahead, behind = (row[1].values for row in model.predict(points, PER_SAMPLE, False))
        for name, slopes in at[1].sensitivities.items():
            expected = (ahead[name] - behind[name]) / (2.0 * e)
            np.testing.assert_allclose(slopes[:, k], expected, atol=1e-3 * max(np.abs(slopes).max(), 1e-12))


def test_an_uninformed_unknown_keeps_its_prior(campaign):
    problem = problem_of(campaign)
    uninformed = unknown_around(campaign.machine, "stop_stiffness", Spread(0.2))
    result = fit(dataclasses.replace(problem, unknowns=(*problem.unknowns, uninformed)), starts=1)
    assert result.std[-1] == pytest.approx(1.0, abs=1e-6) and result.x[-1] == pytest.approx(0.0, abs=1e-6)
    assert Calibration(result, None, (), {}, {}, 0.0).unidentified() == ["stop_stiffness"]


def test_a_narrow_prior_limits_the_estimate():
    campaign = measured(empty_campaign(uncertain={"mover_damping": 0.01}), edhas.change(bench(), mover_damping=25.0))
    result = fit(problem_of(campaign), starts=1)
    assert 20.2 < result.values["mover_damping"] < 21.0  # no further than four standard deviations
    assert Calibration(result, None, (), {}, {}, 0.0).implausible() == ["mover_damping"]


def test_an_uncertain_condition_is_scaled_by_a_common_factor():
    set_to = 1.2, 1.6, 1.4
    conditions = tuple(given | {"coil_resistance": value} for given, value in zip(CONDITIONS, set_to, strict=True))
    campaign = empty_campaign(conditions=conditions)
    campaign = measured(campaign, edhas.change(bench(), coil_resistance=1.41 * 1.03))
    factor = unknown_around(campaign.machine, "coil_resistance", Spread(0.02))
    result = fit(FitProblem(campaign, campaign.machine, (factor,)), starts=1)
    low, high = result.interval("coil_resistance", 3.0)
    assert low < 1.41 * 1.03 < high and high - low < 0.02


def test_a_certain_condition_cannot_be_estimated(campaign):
    with pytest.raises(ParameterError, match="frequency: is set by the runs"):
        fit(FitProblem(campaign, campaign.machine, (unknown_around(campaign.machine, "frequency", Spread(0.1)),)))


def test_the_lag_of_a_sensor_is_estimated():
    chain = Instruments({"current": (SensorLag(lag_time=1.5e-3),)})
    campaign = measured(empty_campaign(), bench(), chain)
    unknowns = (
        unknown_around(campaign.machine, "coil_resistance", Spread(0.02)),
        UnknownParameter("current.sensor_lag.lag_time", 3e-3, 1.0, "s", (1e-5, 0.05), has_prior=False),
    )
    guess = Instruments({"current": (SensorLag(lag_time=3e-3),)})
    result = fit(FitProblem(campaign, campaign.machine, unknowns, guess), starts=2)
    assert result.values["current.sensor_lag.lag_time"] == pytest.approx(1.5e-3, abs=5 * result.std[1] * 1.5e-3)
    assert float(result.instruments.chains["current"][0].lag_time) == result.values["current.sensor_lag.lag_time"]
    assert float(get_parameter(result.machine, "coil_resistance")) == result.values["coil_resistance"]


def test_missing_samples_are_ignored(campaign, found):
    runs = []
    for run in campaign.runs:
        signals = {n: v.copy() for n, v in run.signals.items()}
        signals["current"][50:90] = np.nan
        signals["voltage"][:] = np.nan
        runs.append(dataclasses.replace(run, signals=signals))
    result = fit(problem_of(dataclasses.replace(campaign, runs=tuple(runs))), starts=1)
    assert result.values["force_constant"] == pytest.approx(TRUTH["force_constant"], rel=0.01)
    assert (result.std >= found.std).all()


def test_a_sample_without_a_prediction_is_a_failure_and_not_a_missing_sample(campaign):
    problem = problem_of(campaign)
    (outcomes,) = problem.predict(np.zeros((1, len(problem.unknowns))), PER_SAMPLE, with_sensitivities=True)
    index = dict(enumerate(outcomes))

    def cost(of_problem):
        return quadratic_model_at(of_problem, np.zeros(len(problem.unknowns)), index).cost[0]

    whole = cost(problem)
    index[0].values["current"][7] = np.nan
    run = problem.model().runs[0]
    current = run.signals["current"].copy()
    current[7] = np.nan
    gap = dataclasses.replace(run, signals=run.signals | {"current": current})
    assert cost(problem) == np.inf
    assert 0.9 * whole < cost(dataclasses.replace(problem, runs=(gap, *problem.model().runs[1:]))) < whole


def test_uneven_time_stamps_are_interpolated(campaign):
    rng = np.random.default_rng(3)
    run = campaign.runs[0]
    jittered = np.sort(run.time + 5e-5 * rng.uniform(-1.0, 1.0, len(run.time)).clip(-0.9, 0.9))
    jittered[0] = 0.0
    other = dataclasses.replace(run, time=jittered)
    model = MeasurementModel(campaign, campaign.machine, (), (run, other))
    (out,) = model.predict([EvaluationPoint(np.zeros(0), (0, 1))], PER_SAMPLE, with_sensitivities=False)
    for name, values in out[0].values.items():
        expected = np.interp(jittered, run.time, values)
        np.testing.assert_allclose(out[1].values[name], expected, atol=5e-3 * np.ptp(values))


def test_drift_is_detected_in_a_parameter_that_differs_between_runs(campaign, found):
    assert np.abs(fit_each_run(found).score).max() < 4.0
    machines = [edhas.change(bench(), **TRUTH), edhas.change(bench(), **(TRUTH | {"coil_resistance": 1.6})), bench()]
    other = measured(empty_campaign(), None, each=machines)
    result = fit(problem_of(other), starts=1)
    noise = {run.name: {"current": np.ones(9)} for run in other.runs}
    calibration = Calibration(result, fit_each_run(result), (), noise, noise, 0.0)
    assert "coil_resistance" in calibration.drifting()
    assert any("drifts from run to run" in sentence for sentence in calibration.findings())


def test_two_runs_are_equally_far_from_the_common_estimate_on_either_side():
    """Of one unknown: x₁ − x = w₂ (x₁ − x₂) and x₂ − x = −w₁ (x₁ − x₂), which is both ±(x₁ − x₂)/√(v₁ + v₂)."""
    machines = [edhas.change(bench(), coil_resistance=value) for value in (1.50, 1.56, 1.50)]
    plan = empty_campaign(uncertain={"coil_resistance": 0.5}, lengths=(401, 151, 301))
    other = measured(plan, None, each=machines)
    drift = fit_each_run(fit(problem_of(other), starts=1))
    (first, second), (std, of_other) = drift.score[:, 0], drift.std[:, 0]
    assert max(std, of_other) > 1.2 * min(std, of_other)
    expected = (drift.x[0, 0] - drift.x[1, 0]) / np.hypot(std, of_other)
    assert abs(expected) > 5.0
    # the signals are not quite linear in the resistance
    assert first == pytest.approx(expected, rel=0.1) and second == pytest.approx(-expected, rel=0.1)


def test_the_profile_of_a_nearly_linear_unknown_is_a_parabola(found):
    profile = profile_likelihood(found, "force_constant")
    distance = (profile.x - found.x[1]) / found.std[1]
    np.testing.assert_allclose(profile.chi2_increase, distance**2, atol=0.15 + 0.1 * distance.max() ** 2)
    low, high = profile.interval()
    assert (low, high) == pytest.approx(found.interval("force_constant"), rel=2e-4)


def test_the_step_follows_the_allowed_error_over_noise(campaign):
    model = MeasurementModel(campaign, campaign.machine, (), campaign.runs)
    chosen = choose_time_resolution(model, np.zeros(0), share=0.1)
    assert chosen.error < 0.1 and chosen.coarse <= chosen.fine
    strict = choose_time_resolution(model, np.zeros(0), share=1e-3)
    assert strict.fine > chosen.fine


def test_a_problem_without_unknowns_or_runs_is_refused(campaign):
    with pytest.raises(FitError, match="nothing is named under `uncertain`"):
        fit(FitProblem(campaign, campaign.machine, ()))
    only_holdout = dataclasses.replace(campaign, runs=campaign.runs[2:])
    with pytest.raises(FitError, match="no run has `use: fit`"):
        fit(problem_of(only_holdout))


def test_the_result_folder(campaign, found, tmp_path):
    machines = campaign.machine, found.machine
    before, after = (campaign_residuals(campaign, m, Instruments(), PER_SAMPLE) for m in machines)
    profiles = (profile_likelihood(found, "coulomb_friction"),)
    result = Calibration(found, fit_each_run(found), profiles, before, after, 1.0)
    save_calibration(result, tmp_path)
    saved = json.loads((tmp_path / "fit.json").read_text())
    assert saved["calibrated"]["coil_resistance"]["unit"] == "ohm"
    assert saved["calibrated"]["coil_resistance"]["value"] == pytest.approx(1.45, rel=1e-2)
    assert saved["error"]["before"]["holdout"]["overall"] > saved["error"]["calibrated"]["holdout"]["overall"]
    assert set(saved["error"]["calibrated"]["fit"]) == {"overall", *campaign.channels}
    config = read_config(tmp_path / "config.yaml")
    assert get_parameter(config.machine, "mover_damping") == pytest.approx(found.values["mover_damping"], rel=1e-12)
    edhas.simulate(config.machine, dataclasses.replace(config.simulation, duration=0.01))
    text = fit_report(result)
    assert text.count("data:image/png") >= 4 and "held-out runs" in text


def write(campaign, folder):
    """The campaign as files."""
    folder.mkdir()
    lines = ["rig: actuator_bench", "reference: {kind: sine, ramp_time: 50 ms}", "uncertain:"]
    lines += [f"  {n}: {spread.size}" for n, spread in campaign.uncertain.items()]
    lines += ["signals:", "  voltage: {unit: V, noise: 0.02}", "  current: {unit: A, noise: 0.02}",
              "  piston_position: {unit: m, noise: 5e-6}", "runs:"]  # fmt: skip
    for run in campaign.runs:
        conditions = f"frequency: {run.conditions['frequency']} Hz, amplitude: {run.conditions['amplitude']} m"
        lines.append(f"  - {{file: {run.file}, use: {run.use.value}, {conditions}}}")
        columns = {"time [s]": run.time, "voltage [V]": run.signals["voltage"], "current [A]": run.signals["current"],
                   "piston_position [m]": run.signals["piston_position"]}  # fmt: skip
        rows = np.stack(list(columns.values()), axis=1).tolist()
        text = [",".join(columns), *(",".join(map(repr, row)) for row in rows)]
        (folder / run.file).write_text("\n".join(text) + "\n")
    (folder / "campaign.yaml").write_text("\n".join(lines) + "\n")


def test_the_fit_command(campaign, found, tmp_path, capsys):
    write(campaign, tmp_path / "bench")
    out = tmp_path / "out"
    assert main(["fit", str(tmp_path / "bench"), "--out", str(out), "--starts", "1"]) == 0
    printed = capsys.readouterr().out
    assert "held-out runs: 1.0" in printed or "held-out runs: 0.9" in printed
    estimates = json.loads((out / "fit.json").read_text())["calibrated"]
    for name, value in found.values.items():
        assert estimates[name]["value"] == pytest.approx(value, abs=0.3 * found.standard_errors[name])
    assert {p.name for p in out.iterdir()} == {
        "config.yaml", "files.json", "fit.json", "report.html", "summary.json"
    }  # fmt: skip
    assert main(["fit", str(tmp_path / "bench"), "--out", str(out)]) == 2
    assert "exists already" in capsys.readouterr().err
