"""Wrong samples that only the residual of a fit shows."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.inference.likelihood.residual_outliers import without_missing, without_outliers
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.measurements.campaign import Channel, Use
from studies.synthetic_campaign import PlannedRun, planned_campaign

FREQUENCY, INTERVAL, SAMPLES = 10.0, 5e-4, 1200
PER_CYCLE = round(1.0 / (FREQUENCY * INTERVAL))


@pytest.fixture(scope="module")
def campaign():
    """One run of an actuator with a current that the model follows."""
    bench = edhas.ActuatorBench(reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(),))
    run = PlannedRun(Use.FIT, (SAMPLES - 1) * INTERVAL, {"frequency": FREQUENCY, "amplitude": 3e-3})
    plan = planned_campaign("bench", bench, {}, {"current": Channel("A", 0.02)}, (run,), INTERVAL)
    time = INTERVAL * np.arange(SAMPLES)
    runs = [dataclasses.replace(r, time=time, signals={"current": np.sin(2e2 * time)}) for r in plan.runs]
    return dataclasses.replace(plan, runs=tuple(runs))


def residuals_of(campaign, values):
    return {campaign.runs[0].name: {"current": values}}


def recorded(campaign, residual):
    """The campaign with the deviations of a residual in its record."""
    (run,) = campaign.runs
    signals = {"current": run.signals["current"] + 0.02 * np.nan_to_num(residual)}
    return dataclasses.replace(campaign, runs=(dataclasses.replace(run, signals=signals),))


def left_out(campaign):
    return set(np.flatnonzero(np.isnan(campaign.runs[0].signals["current"])))


def test_a_single_wrong_sample_is_left_out_and_said(campaign):
    residual = np.random.default_rng(1).standard_normal(SAMPLES)
    residual[[517, 803]] += 18.0, -25.0
    cleaned = without_outliers(recorded(campaign, residual), residuals_of(campaign, residual))
    assert left_out(cleaned) == {517, 803}
    (remark,) = cleaned.remarks[len(campaign.remarks) :]
    assert remark.sentence.startswith("current: 2 samples with a residual far from that of the neighbours")


def test_beside_a_gap_a_sample_is_judged_too(campaign):
    residual = np.random.default_rng(2).standard_normal(SAMPLES)
    residual[600:603], residual[605] = np.nan, 20.0
    assert left_out(without_outliers(recorded(campaign, residual), residuals_of(campaign, residual))) == {605}


def test_what_repeats_in_every_cycle_is_no_wrong_sample(campaign):
    residual = np.random.default_rng(3).standard_normal(SAMPLES)
    residual[70::PER_CYCLE] += 15.0
    measured = recorded(campaign, residual)
    assert without_outliers(measured, residuals_of(campaign, residual)) is measured


def test_a_spike_of_the_model_removes_no_sample(campaign):
    residual = np.random.default_rng(6).standard_normal(SAMPLES)
    measured = recorded(campaign, residual)
    residual[[200, 517]] += 30.0
    assert without_outliers(measured, residuals_of(campaign, residual)) is measured


def test_a_step_that_the_model_makes_one_sample_late_removes_no_sample(campaign):
    residual = np.random.default_rng(7).standard_normal(SAMPLES)
    step = np.where(np.arange(SAMPLES) >= 400, 40.0, 0.0)
    measured = recorded(campaign, residual + step)
    residual[400] += 40.0
    assert without_outliers(measured, residuals_of(campaign, residual)) is measured


def test_smooth_misfit_is_no_wrong_sample(campaign):
    phase = 2.0 * np.pi * FREQUENCY * INTERVAL * np.arange(SAMPLES)
    residual = np.random.default_rng(4).standard_normal(SAMPLES) + 30.0 * np.sin(3.0 * phase)
    measured = recorded(campaign, residual)
    assert without_outliers(measured, residuals_of(campaign, residual)) is measured


def test_the_campaign_follows_from_its_residuals(campaign):
    residual = np.random.default_rng(5).standard_normal(SAMPLES)
    residual[200] += 30.0
    measured = recorded(campaign, residual)
    cleaned = without_outliers(measured, residuals_of(campaign, residual))
    residual[200] = np.nan
    again = without_missing(measured, residuals_of(campaign, residual))
    assert left_out(again) == left_out(cleaned) == {200} and again.remarks == cleaned.remarks
