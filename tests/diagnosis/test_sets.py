"""The posterior over sets of effects: its linear algebra against dense matrices, and campaigns with known answers."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.diagnosis.calibration.fit_problem import quadratic_model
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem
from edhas_jax.diagnosis.search.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.diagnosis.sets.diagnose import posterior_over_sets
from edhas_jax.diagnosis.sets.linear_model import Floor, LinearModel, effective_samples, floor_of
from edhas_jax.diagnosis.sets.posterior import NOTHING, SetPosterior
from edhas_jax.diagnosis.sets.set_search import FREEDOMS, FittedSet, log_student
from edhas_jax.machine.effects import CoggingForce, EddyDrag, InverterDeadTime, MagneticSaturation
from edhas_jax.measurements.instruments import Instruments
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign, measured

LIBRARY = (InverterDeadTime, MagneticSaturation, EddyDrag, CoggingForce)


@pytest.fixture(scope="module")
def fitted():
    campaign = measured(empty_campaign(), edhas.change(bench(), coil_resistance=1.45, mover_damping=25.0))
    problem = build_problem(campaign, campaign.machine, Instruments(), ())
    return fit_coarse(problem, start_coordinates(problem, {}), PER_SAMPLE, 15)


@pytest.fixture(scope="module")
def model(fitted):
    """The linear model around a fit, with a background of seven random directions."""
    samples = LinearModel(fitted.fit, None, np.zeros((fitted.samples, 0))).samples
    return LinearModel(fitted.fit, None, np.random.default_rng(1).standard_normal((samples, 7)) / np.sqrt(samples))


def scaled_columns(model, floor):
    """The columns (m, q) of a linear model, those of the background times the size of the floor."""
    of_background = np.arange(model.columns.shape[1]) >= model.first_of_background
    return model.columns * np.where(of_background, floor.size, 1.0)


def dense_covariance(model, floor):
    """The covariance (m, m) of the residual that the columns of a linear model give, all priors proper."""
    columns = scaled_columns(model, floor)
    return floor.noise**2 * np.eye(model.samples) + columns @ columns.T


def test_the_misfit_is_the_negative_log_evidence(model):
    """Its difference between two floors of the same noise is that of −ln N(r; mean, K), K a dense covariance.

    No noise is left out here: the scatter that `misfit` forgives is the same number for both.
    """

    def negative_log_density(floor):
        offset = model.residual - scaled_columns(model, floor) @ model.pull  # the prior is around −pull
        matrix = dense_covariance(model, floor)
        return 0.5 * offset @ np.linalg.solve(matrix, offset) + 0.5 * np.linalg.slogdet(matrix)[1]

    def misfit(floor):
        left = model.at(floor).left
        forgiven = model.samples + 2.0 * np.sqrt(2.0 * model.samples)
        return model.at(floor).misfit + 0.5 * min(left @ left, forgiven)

    small, large = Floor(0.0), Floor(30.0)
    difference = negative_log_density(large) - negative_log_density(small)
    assert misfit(large) - misfit(small) == pytest.approx(difference, rel=1e-6)


def test_further_columns_are_reduced_as_by_dense_matrices(model):
    rows = np.random.default_rng(2).standard_normal((3, model.samples))
    floor = Floor(3.0, 1.7)
    inverse = np.linalg.inv(dense_covariance(model, floor))
    inner, overlap = model.at(floor).reduced(model.products(rows), rows @ rows.T)
    assert inner == pytest.approx(rows @ inverse @ rows.T, rel=1e-6)
    offset = model.residual - scaled_columns(model, floor) @ model.pull
    assert overlap == pytest.approx(rows @ inverse @ offset, rel=1e-5, abs=1e-6 * np.abs(overlap).max())
    diagonal, _ = model.at(floor).reduced(model.products(rows), np.sum(rows**2, axis=1))
    assert diagonal == pytest.approx(np.diag(inner))


def test_white_noise_is_worth_all_its_samples_and_a_sine_is_worth_few():
    noise, time = np.random.default_rng(3).standard_normal(4000), np.arange(4000)
    assert effective_samples(noise, np.array([2000, 4000])) == pytest.approx(4000, rel=0.1)
    assert effective_samples(np.sin(2 * np.pi * 0.01 * time), np.array([4000])) < 10


def test_a_fit_without_misfit_has_no_background(model):
    assert floor_of(model, np.array([model.samples]), np.array([0.0, 10.0, 1000.0])).size == 0.0


def test_a_robust_fit_leaves_to_the_background_what_it_can_do(fitted):
    """With the background along the derivative of one parameter, the data say nothing of that parameter."""
    problem, place = fitted.fit.problem, int(np.argmin(fitted.fit.std))
    background = {
        run.name: {n: 1e4 * v[:, [place]] for n, v in outcome.sensitivities.items()}
        for run, outcome in zip(problem.model().runs, fitted.fit.outcomes, strict=True)
    }
    start = np.where(np.arange(len(fitted.fit.x)) == place, 2.5, fitted.fit.x)
    robust = fit_coarse(dataclasses.replace(problem, background=background), start, PER_SAMPLE, 15)
    assert fitted.fit.std[place] < 0.1
    assert robust.fit.std[place] > 0.9 and abs(robust.fit.x[place]) < 0.1


def test_noise_of_twice_the_size_is_worth_a_quarter_of_the_information(fitted):
    doubled = dataclasses.replace(fitted.fit.problem, bench=type(fitted.fit.problem.bench)(), noise_factor=2.0)
    plain = dataclasses.replace(doubled, noise_factor=1.0)
    of_data = [
        quadratic_model(p, fitted.fit.x, p.equations(fitted.fit.outcomes)).curvature[0] - np.eye(len(fitted.fit.x))
        for p in (plain, doubled)
    ]
    assert 4.0 * of_data[1] == pytest.approx(of_data[0], rel=1e-9)


def test_far_above_the_noise_only_the_ratio_of_misfits_counts():
    assert log_student(1.0) - log_student(2.0) == pytest.approx(1.0, abs=0.1)
    halved = 0.5 * FREEDOMS * np.log(2.0)
    assert log_student(1e5) - log_student(2e5) == pytest.approx(halved, rel=1e-3)
    assert log_student(1e6) - log_student(2e6) == pytest.approx(halved, rel=1e-3)


def a_set(weight, *kinds):
    return FittedSet(tuple(Candidate(kind) for kind in kinds), None, None, Floor(), np.log(weight))


def test_probabilities_are_sums_over_sets():
    dead, eddy, cogging = InverterDeadTime, EddyDrag, CoggingForce
    found = SetPosterior((a_set(0.6, dead), a_set(0.3, dead, eddy), a_set(0.07, cogging), a_set(0.03)))
    assert found.probabilities["inverter_dead_time"] == pytest.approx(0.9)
    assert found.probabilities["eddy_drag"] == pytest.approx(0.3)
    assert found.probabilities[NOTHING] == pytest.approx(0.03)
    assert found.credible == ("inverter_dead_time", "cogging_force")


@pytest.mark.parametrize("effects", [(), (InverterDeadTime(dead_time_voltage=0.5), CoggingForce())])
def test_the_hidden_effects_are_the_most_probable_set(effects):
    truth = structs.replace(bench(), effects=(*bench().effects, *effects))
    found = posterior_over_sets(measured(empty_campaign(), truth), LIBRARY)
    assert found.sets[0].key == {effect.id for effect in effects}
    assert found.weights[0] > 0.5
