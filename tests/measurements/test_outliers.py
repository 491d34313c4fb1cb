"""Outliers of moderate size and short drop-outs are found without the model; sharp events of the machine are kept."""

import math

import numpy as np
import pytest

from edhas_jax.measurements.checks.gap_test import GapTest
from edhas_jax.measurements.checks.held_values import find_held_values
from edhas_jax.measurements.checks.noise_correlation import autocorrelation_of
from edhas_jax.measurements.checks.outlier_search import Record, find_outliers

INTERVAL, PERIOD, NOISE = 2e-4, 0.05, 0.02
TIME = INTERVAL * np.arange(1600)


def smooth(amplitude=3.0):
    return amplitude * np.sin(2.0 * np.pi * TIME / PERIOD)


def with_impacts():
    """Valve impacts: one sample wide and 20 standard deviations high, at the same phase of every cycle."""
    values = smooth()
    values[60::250] += 20.0 * NOISE
    return values


def records(rng, values, count=8, period=PERIOD, model=None):
    """Runs with the same signal and white noise."""
    rows = [values + NOISE * rng.standard_normal(len(values)) for _ in range(count)]
    return [Record(row, model, INTERVAL, period, 0) for row in rows]


def found_indices(records, **noise):
    return [np.flatnonzero(mask).tolist() for mask in find_outliers(records, NOISE, noise.get("correlation", ()))]


@pytest.mark.parametrize(("size", "share"), [(6.0, 0.6), (8.0, 0.95), (10.0, 0.98)])
def test_spikes_in_one_of_500_samples_are_found(size, share):
    rng = np.random.default_rng(0)
    rows, hits = records(rng, smooth(), 40), []
    for row in rows:
        hit = rng.uniform(size=len(TIME)) < 0.002
        row.values[hit] += size * NOISE * rng.choice([-1.0, 1.0], hit.sum())
        hits.append(hit)
    masks, hits = np.array(find_outliers(rows, NOISE, ())), np.array(hits)
    assert (masks & hits).sum() > share * hits.sum()
    assert (masks & ~hits).sum() <= 3


@pytest.mark.parametrize("period", [PERIOD, None])
def test_noise_alone_has_no_outliers(period):
    rng = np.random.default_rng(1)
    found = [found_indices(records(rng, smooth(), period=period)) for _ in range(20)]
    assert sum(len(row) for rows in found for row in rows) <= 1  # 20 signals, one in a thousand expected


def test_correlated_noise_has_no_outliers_and_hides_none():
    rng, coefficients = np.random.default_rng(2), (0.6,)
    rows = []
    for _ in range(8):
        innovation, noise = rng.standard_normal(len(TIME)), np.zeros(len(TIME))
        for k in range(1, len(noise)):
            noise[k] = 0.6 * noise[k - 1] + 0.8 * innovation[k]
        rows.append(Record(smooth() + NOISE * noise, None, INTERVAL, PERIOD, 0))
    assert not any(found_indices(rows, correlation=coefficients))
    rows[3].values[700] += 8.0 * NOISE
    assert found_indices(rows, correlation=coefficients)[3] == [700]


def test_impacts_at_the_same_phase_of_every_cycle_are_kept_and_a_spike_beside_them_found():
    rows = records(np.random.default_rng(3), with_impacts())
    assert not any(found_indices(rows))
    rows[0].values[640] += 8.0 * NOISE
    assert found_indices(rows)[0] == [640]


def test_an_impact_that_the_model_has_is_kept_in_a_run_without_cycles():
    values, model = smooth(), smooth()
    values[700], model[703] = values[700] + 10.0 * NOISE, model[703] + 8.0 * NOISE
    rng = np.random.default_rng(4)
    assert found_indices(records(rng, values, 1, None)) == [[700]]
    assert found_indices(records(rng, values, 1, None, model)) == [[]]


def test_a_bend_of_the_signal_is_no_outlier():
    bent = np.abs(np.sin(2.0 * np.pi * TIME / 0.3 + 0.4)) * 60.0 * NOISE
    assert not any(found_indices(records(np.random.default_rng(5), bent, period=None)))


def test_two_wrong_samples_side_by_side_are_found_where_cycles_repeat():
    rows = records(np.random.default_rng(6), smooth())
    rows[1].values[900:902] += 9.0 * NOISE
    assert found_indices(rows)[1] == [900, 901]


def test_missing_samples_and_short_records_are_no_outliers():
    rows = records(np.random.default_rng(7), smooth(), 2)
    rows[0].values[400:430] = np.nan
    short = Record(rows[1].values[:10], None, INTERVAL, PERIOD, 0)
    assert found_indices([*rows, short]) == [[], [], []]


@pytest.mark.parametrize("coefficients", [(), (0.6,), (0.9, -0.4)])
def test_probabilities_are_those_of_the_noise(coefficients):
    rng, count = np.random.default_rng(8), 200_000
    innovation, noise = rng.standard_normal(count), np.zeros(count)
    for k in range(2, count):
        noise[k] = innovation[k] + sum(a * noise[k - 1 - j] for j, a in enumerate(coefficients))
    share = 1.0 - sum(a * r for a, r in zip(coefficients, autocorrelation_of(coefficients, 2)[1:], strict=False))
    noise *= math.sqrt(share)
    found = GapTest(1, 6, 1.0, coefficients).suspects(noise)
    # the straight line and neighbours that happen to scatter more than the noise make the test more careful
    assert 10 < (found.probability < 5e-4).sum() < 110  # 100 of 200 000
    assert (found.probability < 1e-4).sum() < 35


def test_held_values_and_zeros_are_found():
    rng = np.random.default_rng(9)
    values = smooth()[:1500] + NOISE * rng.standard_normal(1500)
    values[300:306], values[800:806], values[1000:1002] = values[300], 0.0, values[1000]
    found = np.flatnonzero(find_held_values(values, NOISE, 0.0))
    assert found.tolist() == [301, 302, 303, 304, 305, *range(800, 806)]


@pytest.mark.parametrize("resolution", [0.1, 0.5, 3.0])
def test_a_live_sensor_with_a_coarse_recorder_holds_no_values(resolution):
    rng = np.random.default_rng(10)
    for amplitude in (0.0, 3.0):
        for _ in range(20):
            values = smooth(amplitude) + NOISE * rng.standard_normal(len(TIME))
            values = np.round(values / (resolution * NOISE)) * resolution * NOISE
            assert not find_held_values(values, NOISE, resolution * NOISE).any()
