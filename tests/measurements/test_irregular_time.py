"""Predictions at time stamps that are no multiples of the sample interval: interpolated from a finer grid."""

import dataclasses

import numpy as np
import pytest

from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign

INTERVAL = 5e-4  # s


def model_with(times) -> MeasurementModel:
    """A measurement model whose runs have the given time stamps."""
    campaign = empty_campaign()
    runs = tuple(
        dataclasses.replace(run, time=time, lines=np.arange(len(time)) + 2)
        for run, time in zip(campaign.runs, times, strict=False)
    )
    return MeasurementModel(campaign, bench(), uncertain_unknowns(campaign, bench()), runs)


@pytest.fixture(scope="module")
def regular():
    return [run.time for run in empty_campaign().runs]


def test_values_between_samples_are_those_of_the_steps(regular):
    """A quarter of a sample interval is two of its eight steps, so that the finer grid has these points itself."""
    x, late = np.full(4, 0.3), 0.25 * INTERVAL
    between = model_with([time + late for time in regular]).predict_all_runs(x, PER_SAMPLE, with_sensitivities=True)
    finer = model_with([np.arange(4 * len(time)) * late for time in regular])
    finer = finer.predict_all_runs(x, PER_SAMPLE // 4, with_sensitivities=True)
    for r, found in between.items():
        for name, values in found.values.items():
            expected = finer[r].values[name][1::4][: len(values)]
            np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-9 * np.ptp(values))
            slopes, dense = found.sensitivities[name], finer[r].sensitivities[name][1::4][: len(values)]
            np.testing.assert_allclose(slopes, dense, rtol=1e-7, atol=1e-7 * np.ptp(dense))


def test_a_finer_grid_interpolates_better(regular):
    """For time stamps on neither grid, four points per sample interval are better than the samples alone."""
    x, shift = np.zeros(4), 0.13 * INTERVAL
    times = [time + shift for time in regular]
    exact = model_with([np.arange(100 * (len(time) - 1)) * 0.01 * INTERVAL for time in regular])
    exact = exact.predict_all_runs(x, 1)
    # no finer grid divides seven steps
    errors = {}
    for steps in (7, 8):
        found = model_with(times).predict_all_runs(x, steps)
        reference = {r: of.values["voltage"][13::100] for r, of in exact.items()}
        n = min(len(reference[0]), len(found[0].values["voltage"]))
        errors[steps] = np.abs(found[0].values["voltage"][:n] - reference[0][:n]).max()
    assert errors[8] < 0.5 * errors[7]


def test_runs_with_regular_time_stamps_need_no_finer_grid(regular):
    """A run with irregular time stamps does not change the predictions of the others."""
    x = np.zeros(4)
    alone = model_with(regular).predict_all_runs(x, PER_SAMPLE)
    mixed = model_with([regular[0] + 1e-4, *regular[1:]]).predict_all_runs(x, PER_SAMPLE)
    for name, values in alone[1].values.items():
        assert np.array_equal(values, mixed[1].values[name])
