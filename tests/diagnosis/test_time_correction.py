"""Errors of a recorder's clock: as columns of a fit, as corrected time stamps, and as a deviation of the bench."""

import dataclasses
import json
import math

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from edhas_jax.diagnosis.search.checkpoint import fit_as_plain, fit_of_plain
from edhas_jax.inference.fit.calibrated_model import calibrate
from edhas_jax.inference.fit.fit_problem import FitProblem, calibration_problem
from edhas_jax.inference.fit.time_correction import (
    added,
    time_error,
    with_corrected_time,
    with_time_errors,
)
from edhas_jax.inference.likelihood.bench_deviations import (
    DeviationKind,
    bench_deviations,
    clock_degree,
    deviation_columns,
)
from edhas_jax.measurements.accuracy import BenchAccuracy
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.sensor_models import SensorLag
from studies.synthetic_campaign import synthesise
from tests.support.synthetic_campaign import CHANNELS, bench, empty_campaign, measured

FINE = 5e-5  # s, sample interval of the trajectories from which the signals are interpolated
AMPLITUDE, FREQUENCY = 1.5e-4, 3.0  # of the sinusoidal error of a clock [s, Hz]


def true_times(time: np.ndarray) -> np.ndarray:
    """The true times of samples whose recorded times have a sinusoidal error."""
    return time + AMPLITUDE * np.sin(2.0 * math.pi * FREQUENCY * time + 0.5) - AMPLITUDE * math.sin(0.5)


def recorded_with(clock, seed: int = 0) -> Campaign:
    """Runs of the actuator bench, sampled at the times that `clock` gives for the recorded ones."""
    plan = empty_campaign(lengths=(601, 401, 301))
    exact = {n: dataclasses.replace(c, noise=1e-9 * c.noise) for n, c in CHANNELS.items()}
    finer = tuple(dataclasses.replace(run, time=FINE * np.arange(10 * len(run.time))) for run in plan.runs)
    fine = synthesise(dataclasses.replace(plan, runs=finer, channels=exact), bench(), np.random.default_rng(seed))
    rng, runs = np.random.default_rng(seed + 1), []
    for run, dense in zip(plan.runs, fine.runs, strict=True):
        signals = {
            n: CubicSpline(dense.time, dense.signals[n])(clock(run.time)) + c.noise * rng.standard_normal(len(run.time))
            for n, c in CHANNELS.items()
        }
        runs.append(dataclasses.replace(run, signals=signals))
    settings = {**plan.stated_accuracy.settings, "force_constant": 0.0}  # the magnets are equally warm in all runs
    accuracy = dataclasses.replace(plan.stated_accuracy, settings=settings)
    return dataclasses.replace(plan, runs=tuple(runs), is_checked=True, stated_accuracy=accuracy)


def with_clock_error(campaign, size):
    """The campaign with another accuracy [s] of the clock of its recorder."""
    return dataclasses.replace(campaign, stated_accuracy=BenchAccuracy(clock_error=size))


@pytest.fixture(scope="module")
def wrong_records():
    campaign = recorded_with(true_times)
    return campaign, calibrate(campaign)[0]


def test_degrees_follow_changes_of_the_rate_up_to_a_frequency():
    run = empty_campaign().runs[0]
    assert clock_degree(run) == 3  # 0.2 s
    assert clock_degree(dataclasses.replace(run, time=10.0 * run.time)) == 8


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_a_column_is_the_change_of_a_signal_by_a_small_time_error(degree):
    campaign = with_clock_error(empty_campaign(), 1e-6)
    problem = calibration_problem(campaign)
    run = campaign.runs[0]
    deviation = next(d for d in problem.bench.of_runs if d.kind is DeviationKind.CLOCK and d.degree == degree)
    signal = lambda t: np.sin(60.0 * t)  # noqa: E731
    predicted = PredictedSignals({"current": signal(run.time)}, {"current": np.zeros((len(run.time), 0))})
    (column,) = deviation_columns([deviation], run, "current", predicted, ()).T
    later = run.time + time_error(run, tuple(1e-6 * np.eye(degree + 1)[-1]))
    np.testing.assert_allclose(column[2:-2], (signal(later) - signal(run.time))[2:-2], atol=3e-3 * np.abs(column).max())


def test_a_column_beyond_the_degree_of_its_run_is_empty():
    short, long = (0.1 * empty_campaign().runs[0].time, empty_campaign().runs[1].time)
    runs = tuple(dataclasses.replace(empty_campaign().runs[0], time=t, lines=np.arange(len(t))) for t in (short, long))
    campaign = with_clock_error(dataclasses.replace(empty_campaign(), runs=runs), 1e-6)
    deviations = [d for d in bench_deviations(campaign, ()).of_runs if d.kind is DeviationKind.CLOCK]
    assert [d.degree for d in deviations] == list(range(1, clock_degree(runs[1]) + 1))
    predicted = PredictedSignals({"current": np.sin(60.0 * short)}, {"current": np.zeros((len(short), 0))})
    columns = deviation_columns(deviations, runs[0], "current", predicted, ())
    assert np.flatnonzero(np.abs(columns).max(axis=0)).tolist() == list(range(clock_degree(runs[0])))


def test_samples_before_the_start_of_the_run_are_left_out():
    campaign = recorded_with(lambda time: time)
    errors = {"run1": (-2e-3, 1e-3)}
    moved = with_corrected_time(campaign, errors)
    before, after = campaign.runs[0], moved.runs[0]
    np.testing.assert_allclose(after.time[[0, -1]] - before.time[[0, -1]], [-3e-3, -1e-3])
    assert np.isnan(after.signals["current"]).sum() == np.sum(after.time < 0.0) > 0
    assert np.array_equal(moved.runs[1].time, campaign.runs[1].time)
    assert added(errors, {"run1": (1e-3,), "run2": (2e-3,)}) == {"run1": (-1e-3, 1e-3), "run2": (2e-3,)}


def test_an_error_of_the_clock_is_found_and_corrected(wrong_records):
    """With the corrected time stamps the model leaves nothing but noise."""
    campaign, found = wrong_records
    assert abs(found.excess) < 3.0 * math.sqrt(0.5 * found.samples)
    for given, corrected in zip(campaign.runs, found.fit.problem.campaign.runs, strict=True):
        if corrected.name in found.fit.problem.time_errors:
            assert np.abs(corrected.time - true_times(given.time)).max() < 0.35 * AMPLITUDE
    rows = [r for r in with_time_errors(found.fit.problem, found.bench) if r.deviation.kind is DeviationKind.CLOCK]
    assert [row.run for row in rows] == [run.name for run in campaign.runs]


def test_with_a_clock_stated_as_exact_the_misfit_stays(wrong_records):
    """No error of the clock is integrated out where the campaign states an exact one."""
    campaign, found = wrong_records
    exact = calibrate(with_clock_error(campaign, 0.0))[0]
    assert exact.excess > 100.0 + 10.0 * max(found.excess, 0.0)


def test_an_exact_clock_has_no_error():
    found = calibrate(recorded_with(lambda time: time))[0]
    assert not found.fit.problem.time_errors


def test_the_lag_of_one_sensor_is_no_error_of_the_clock():
    """It would explain much of the misfit of one signal, and little of the others."""
    lagging = Instruments({"current": (SensorLag(lag_time=1e-3),)})
    found = calibrate(dataclasses.replace(measured(empty_campaign(), bench(), lagging), is_checked=True))[0]
    assert found.excess > 50.0


def test_a_fit_with_corrected_time_is_restored(wrong_records):
    campaign, found = wrong_records
    arrays = {}
    again = fit_of_plain(campaign, json.loads(json.dumps(fit_as_plain(found, arrays))), arrays)
    problem: FitProblem = again.fit.problem
    assert problem.bench == found.fit.problem.bench and problem.time_errors == found.fit.problem.time_errors
    for one, other in zip(problem.campaign.runs, found.fit.problem.campaign.runs, strict=True):
        np.testing.assert_allclose(one.time, other.time, atol=1e-7)
