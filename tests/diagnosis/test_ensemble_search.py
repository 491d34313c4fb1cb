"""Fits of a model whose signals depend irregularly on its parameters."""

import dataclasses
import json

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.diagnosis.search.checkpoint import fit_as_plain, fit_of_plain
from edhas_jax.inference.fit.ensemble_search import minimise_by_ensemble
from edhas_jax.inference.fit.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.inference.fit.fit_problem import FitProblem, calibration_problem, quadratic_model
from edhas_jax.inference.fit.unpredictable_part import unpredictable_part, with_unpredictable_part
from edhas_jax.measurements.measurement_model import EvaluationPoint, PredictedSignals
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}
RATE = 3000.0  # of the phase of the irregular part, per coordinate
SIZE = 0.5  # of the irregular part over the noise


class _Irregular:
    """A model whose signals have a part that looks random from one point to the next, as after a bouncing valve."""

    def __init__(self, model, campaign):
        self._model, self._campaign = model, campaign
        self.runs, self.acting = model.runs, model.acting

    def predict(self, points, steps_per_sample, with_sensitivities):
        found = self._model.predict(points, steps_per_sample, with_sensitivities)
        return [
            {r: self._disturbed(point.x, of) for r, of in by_run.items()}
            for point, by_run in zip(points, found, strict=True)
        ]

    def predict_all_runs(self, x, steps_per_sample, with_sensitivities=False):
        point = EvaluationPoint(x, tuple(range(len(self.runs))))
        return self.predict([point], steps_per_sample, with_sensitivities)[0]

    def _disturbed(self, x, outcome):
        values, slopes = {}, {}
        for name, signal in outcome.values.items():
            size = SIZE * self._campaign.channels[name].noise
            phase = np.arange(len(signal))[:, None] * 0.7 + RATE * np.arange(1, len(x) + 1) * x
            values[name] = signal + size * np.sin(phase).mean(axis=1)
            if outcome.sensitivities is not None:
                slope = size * RATE * np.arange(1, len(x) + 1) * np.cos(phase) / len(x)
                slopes[name] = outcome.sensitivities[name] + slope
        return PredictedSignals(values, slopes or None)


class _IrregularProblem(FitProblem):
    def model(self):
        return _Irregular(super().model(), self.campaign)


@pytest.fixture(scope="module")
def problem():
    campaign = measured(empty_campaign(), edhas.change(bench(), **TRUTH))
    return calibration_problem(campaign)


@pytest.fixture(scope="module")
def irregular(problem):
    fields = {f.name: getattr(problem, f.name) for f in dataclasses.fields(problem)}
    return _IrregularProblem(**fields)


def test_a_regular_model_has_no_unpredictable_part(problem):
    assert unpredictable_part(problem, start_coordinates(problem, {}), PER_SAMPLE) == {}


def test_the_unpredictable_part_is_what_scatters_between_close_neighbours(irregular):
    """The mean of n sines of independent phases has a standard deviation of size/√(2 n)."""
    deviations = unpredictable_part(irregular, start_coordinates(irregular, {}), PER_SAMPLE)
    for name, channel in irregular.campaign.channels.items():
        if any(name in run.signals for run in irregular.model().runs):
            expected = SIZE * channel.noise / np.sqrt(2 * len(irregular.unknowns))
            assert deviations[name] == pytest.approx(expected, rel=0.3)


def test_the_unpredictable_part_counts_as_noise(problem):
    name, channel = next(iter(problem.campaign.channels.items()))
    found = with_unpredictable_part(problem.campaign, {name: 0.75 * channel.noise})
    assert found.channels[name].noise == pytest.approx(1.25 * channel.noise)
    assert found.unpredictable == {name: 0.75 * channel.noise}
    assert with_unpredictable_part(problem.campaign, {}) == problem.campaign


def test_a_regular_model_is_fitted_as_by_its_derivatives(problem):
    """Both searches end at the same cost within half a nat: its rise when one unknown is a standard error off."""
    start = start_coordinates(problem, {})
    derivatives = fit_coarse(problem, start, PER_SAMPLE, 20)
    end = minimise_by_ensemble(problem, start, PER_SAMPLE, 30)
    assert end.model.cost[0] == pytest.approx(derivatives.cost, abs=0.5)
    np.testing.assert_array_less(np.abs(end.x - derivatives.fit.x) / derivatives.fit.std, 1.0)


def test_an_irregular_model_is_fitted_where_its_derivatives_mislead(problem, irregular):
    """Derivatives of the irregular part are 1000 times those of its mean, so that steps along them bring nothing."""
    start = start_coordinates(problem, {})
    regular = fit_coarse(problem, start, PER_SAMPLE, 20)
    by_derivatives = fit_coarse(irregular, start, PER_SAMPLE, 30)
    end = minimise_by_ensemble(irregular, start, PER_SAMPLE, 30)
    begin = fit_coarse(irregular, start, PER_SAMPLE, 0).cost
    rest = (end.model.cost[0] - regular.cost) / (begin - regular.cost)
    assert rest < 0.02
    assert rest < 0.1 * (by_derivatives.cost - regular.cost) / (begin - regular.cost)


def test_the_search_ends_when_it_is_told(problem):
    asked = []

    def keep_on(step, cost):
        asked.append((step, cost))
        return len(asked) < 2

    end = minimise_by_ensemble(problem, start_coordinates(problem, {}), PER_SAMPLE, 30, keep_on)
    assert [step for step, _ in asked] == [1, 2]
    assert asked[1][1] <= asked[0][1]
    assert not end.converged


def test_the_best_of_several_starts_is_followed(problem):
    """A start next to the minimum is preferred to a distant one."""
    start = start_coordinates(problem, {})
    minimum = minimise_by_ensemble(problem, start, PER_SAMPLE, 30)
    asked = []
    starts = np.array([start + 1.0, minimum.x])
    minimise_by_ensemble(problem, starts, PER_SAMPLE, 1, lambda step, cost: asked.append(cost) is None)
    assert asked[0] <= minimum.model.cost[0] + 1.0


def test_an_interrupted_diagnosis_keeps_what_counts_as_noise(problem):
    """A fit that is read again has the noise with which it was made, so that its cost does not change."""
    halves = {name: 0.5 * channel.noise for name, channel in problem.campaign.channels.items()}
    campaign = with_unpredictable_part(problem.campaign, halves)
    made = fit_coarse(dataclasses.replace(problem, campaign=campaign), start_coordinates(problem, {}), PER_SAMPLE, 1)
    arrays = {}
    read = fit_of_plain(problem.campaign, json.loads(json.dumps(fit_as_plain(made, arrays))), arrays)
    assert read.fit.problem.campaign.unpredictable == campaign.unpredictable
    assert read.fit.problem.campaign.channels == campaign.channels
    equations = read.fit.problem.equations(read.fit.outcomes)
    assert quadratic_model(read.fit.problem, read.fit.x, equations).cost[0] == pytest.approx(made.cost, rel=1e-9)
