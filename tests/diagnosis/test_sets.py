"""The posterior over sets of effects: its linear algebra against dense matrices, and campaigns with known answers."""

import dataclasses
import types

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.linear_model import Floor, LinearModel, effective_samples, floor_of
from edhas_jax.diagnosis.search.posterior import NOTHING, UNKNOWN, SetPosterior, labels
from edhas_jax.diagnosis.search.set_search import PREDICTION_ERROR, FittedSet, Move, SetSearch
from edhas_jax.diagnosis.search.weight import Weighing, WeightConstants, log_likelihood
from edhas_jax.inference.fit.evaluated_fit import fit_coarse, start_coordinates
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.machine.effects import CoggingForce, EddyDrag, InverterDeadTime, MagneticSaturation, SupplySag
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign, measured

# not those of the diagnosis, so that what is tested here does not depend on how these are chosen
NUMBERS = WeightConstants(freedoms=30.0, beyond_noise=5.0, law_error=0.01, least_error=10.0)
LIBRARY = (InverterDeadTime, MagneticSaturation, EddyDrag, CoggingForce)


@pytest.fixture(scope="module")
def fitted():
    campaign = measured(empty_campaign(), edhas.change(bench(), coil_resistance=1.45, mover_damping=25.0))
    problem = calibration_problem(campaign)
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
    """Its difference between two floors of the same noise is that of −ln N(r; mean, K), K a dense covariance."""

    def negative_log_density(floor):
        offset = model.residual - scaled_columns(model, floor) @ model.pull  # the prior is around −pull
        matrix = dense_covariance(model, floor)
        return 0.5 * offset @ np.linalg.solve(matrix, offset) + 0.5 * np.linalg.slogdet(matrix)[1]

    small, large = Floor(0.0), Floor(30.0)
    difference = negative_log_density(large) - negative_log_density(small)
    assert model.at(large).misfit - model.at(small).misfit == pytest.approx(difference, rel=1e-6)


def test_what_deviations_of_laws_explain_is_the_fall_of_the_misfit_without_its_determinant(fitted):
    rng, none = np.random.default_rng(2), np.zeros((fitted.samples, 0))
    campaign, runs = fitted.fit.problem.campaign, fitted.fit.problem.model().runs
    deviations = [
        {n: campaign.channels[n].noise * rng.standard_normal((len(run.time), 3)) for n in run.signals} for run in runs
    ]
    without, found = (LinearModel(fitted.fit, d, none).at(Floor()) for d in (None, deviations))
    left = [0.5 * of.left @ of.left + of.squares for of in (without, found)]
    assert found.fall_by_laws == pytest.approx(left[0] - left[1], rel=1e-6) and found.fall_by_laws > 0.1
    assert without.fall_by_laws == 0.0


def test_another_prior_of_some_unknowns_is_that_of_a_dense_covariance(model):
    """A curve around the law of an effect is the same model as one around nothing, with another prior."""
    places, mean, spread = np.array([1, 3]), np.array([0.7, -0.4]), np.array([0.5, 2.0])
    other = model.with_prior(places, mean, spread)

    def negative_log_density(means, spreads):
        offset = model.residual - model.columns[:, :4] @ (means - model.x)
        scale = np.concatenate([spreads, np.ones(model.first_of_background - 4)])
        columns = model.columns[:, : model.first_of_background] * scale
        matrix = np.eye(model.samples) + columns @ columns.T
        return 0.5 * offset @ np.linalg.solve(matrix, offset) + 0.5 * np.linalg.slogdet(matrix)[1]

    means, spreads = np.zeros(4), np.ones(4)
    before = negative_log_density(means, spreads)
    means[places], spreads[places] = mean, spread
    difference = negative_log_density(means, spreads) - before
    assert other.at(Floor()).misfit - model.at(Floor()).misfit == pytest.approx(difference, rel=1e-6)


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


def test_far_above_the_noise_only_the_ratio_of_misfits_counts():
    """Near X₀ each nat counts. Far above it a factor counts, and more of it where the misfit exceeds the noise."""

    def worth(misfit, samples):
        return log_likelihood(misfit, samples, NUMBERS) - log_likelihood(2.0 * misfit, samples, NUMBERS)

    assert worth(1.0, 10**9) == pytest.approx(1.0, abs=0.1)
    assert worth(1e5, 10**9) == pytest.approx(15.0 * np.log(2.0), rel=1e-3)
    assert worth(1e6, 10**9) == pytest.approx(15.0 * np.log(2.0), rel=2e-3)
    assert worth(1e6, 1000) == pytest.approx(20.0 * np.log(2.0), rel=1e-3)


def a_set(weight, *kinds):
    members = tuple(Candidate(kind) for kind in kinds)
    return FittedSet(members, None, None, 0.0, 0.0, 0.0, 1000, log_weight=np.log(weight))


def test_probabilities_are_sums_over_sets():
    """All sets together have 0.9: a tenth is kept for sets that the search has not fitted."""
    dead, eddy, cogging = InverterDeadTime, EddyDrag, CoggingForce
    found = SetPosterior((a_set(0.6, dead), a_set(0.3, dead, eddy), a_set(0.07, cogging), a_set(0.03)))
    assert found.probabilities["inverter_dead_time"] == pytest.approx(0.9 * 0.9)
    assert found.probabilities["eddy_drag"] == pytest.approx(0.9 * 0.3)
    assert found.probabilities[NOTHING] == pytest.approx(0.9 * 0.03)
    assert sum(found.weights) == pytest.approx(0.9)
    assert found.credible == ("inverter_dead_time", "cogging_force")


def test_an_effect_that_explains_nothing_is_no_other_answer():
    """Its set has the weight of the prior alone; with one that explains something it counts."""
    dead, eddy, cogging = InverterDeadTime, EddyDrag, CoggingForce
    idle = dataclasses.replace(a_set(0.2, eddy), gain=0.3)
    found = SetPosterior((a_set(0.6), idle, dataclasses.replace(a_set(0.2, dead), gain=2.0), a_set(0.1, eddy, cogging)))
    assert found.weights == pytest.approx((0.6, 0.0, 0.2, 0.1))
    assert found.near == (found.sets[0], *found.sets[2:])
    assert found.probabilities["eddy_drag"] == pytest.approx(0.1)


def test_the_gain_of_a_set_is_that_of_its_least_member():
    weight, misfits = Weighing(10, 1, 1000, NUMBERS), {}
    for misfit, kinds in ((5e3, ()), (900.0, (EddyDrag,)), (4e3, (CoggingForce,)), (600.0, (EddyDrag, CoggingForce))):
        of = FittedSet(tuple(map(Candidate, kinds)), None, None, misfit, 0.0, 0.0, 1000)
        weight.note(of)
        misfits[of.key] = misfit
    assert weight.gain(frozenset(), misfits) == np.inf
    expected = weight.log_likelihood(600.0) - weight.log_likelihood(900.0)
    assert weight.gain(of.key, misfits) == pytest.approx(expected) and expected > 0.0


def test_what_takes_the_place_of_a_member_is_near_and_as_small():
    """The rest of the set stays; a set of other size, or with far smaller probability, offers nothing."""
    dead, eddy, cogging, sag = InverterDeadTime, EddyDrag, CoggingForce, SupplySag
    best, exchanged = a_set(0.50, dead, eddy), a_set(0.30, dead, cogging)
    others = a_set(0.10, dead, cogging, sag), a_set(0.08, sag, cogging), a_set(0.02, dead, sag)
    found = SetPosterior((best, exchanged, *others))
    assert found.near == found.sets[:4]
    assert found.alternatives(Candidate(eddy)) == (Candidate(cogging),)
    assert found.alternatives(Candidate(dead)) == ()
    assert found.evidence(Candidate(eddy)) == pytest.approx(np.log(0.50 / 0.30))
    assert found.evidence(Candidate(sag)) == pytest.approx(np.log(0.10 / 0.50))


def test_the_evidence_for_an_effect_is_not_against_a_curve_that_may_be_its_law():
    place = LawPlace("coil_voltage_change", "current")
    curve = CurveCandidate(tabulated_class("curve", place, 3), place=place, nodes=(-1.0, 0.0, 1.0))
    with_curve = dataclasses.replace(a_set(0.3), members=(curve,))
    found = SetPosterior((a_set(0.6, InverterDeadTime), with_curve, a_set(0.1)))
    assert found.evidence(Candidate(InverterDeadTime)) == pytest.approx(np.log(0.6 / 0.1))


def test_a_member_counts_by_what_the_misfit_rises_without_it():
    dead, eddy = InverterDeadTime, EddyDrag
    best, without_eddy, without_dead = (
        dataclasses.replace(of, misfit=misfit)
        for of, misfit in ((a_set(0.9, eddy, dead), 500.0), (a_set(0.06, dead), 540.0), (a_set(0.04, eddy), 700.0))
    )
    found = SetPosterior((best, without_eddy, without_dead))
    assert found.members == ((Candidate(dead), 200.0), (Candidate(eddy), 40.0))
    assert SetPosterior((best,)).members[0][1] == np.inf  # a set without the member was never fitted


def test_a_component_with_two_causes_counts_once():
    found = SetPosterior((a_set(0.7, CoggingForce, EddyDrag), a_set(0.2, EddyDrag, InverterDeadTime), a_set(0.1)))
    mover, coil = Candidate(EddyDrag).location, Candidate(InverterDeadTime).location
    assert Candidate(CoggingForce).location == mover != coil
    assert found.locations() == pytest.approx({mover: 0.9 * 0.9, coil: 0.9 * 0.2})


def test_the_empty_set_may_be_an_unknown_cause_where_it_leaves_much():
    empty = dataclasses.replace(a_set(1.0), excess=2000.0)
    assert labels(empty) == (UNKNOWN,) and labels(a_set(1.0)) == (NOTHING,)
    found = SetPosterior((empty, a_set(0.5, EddyDrag)))  # no curve explains it: the records may be wrong as well
    assert found.probabilities == pytest.approx({"unknown": 0.3, "nothing": 0.3, "eddy_drag": 0.3})
    assert next(iter(found.probabilities)) == UNKNOWN and set(found.credible) == {"unknown", "nothing", "eddy_drag"}


def test_the_reference_is_the_noise_or_what_the_best_set_leaves(model):
    """Where no set is at the noise, a fall counts by its share; where one is, by its nats."""
    weight = Weighing(1, 1, 1000, NUMBERS)
    far, farther = (FittedSet((), None, None, misfit, 100.0, misfit, 1000) for misfit in (4e5, 8e5))
    weight.note(far), weight.note(farther)
    assert weight.of(far) - weight.of(farther) == pytest.approx(20.0 * np.log(2.0), rel=1e-2)
    at_noise = FittedSet((), None, None, 550.0, 60.0, 0.0, 1000)
    weight = Weighing(1, 1, 1000, NUMBERS)
    weight.note(at_noise)
    assert weight.of(at_noise) == pytest.approx(log_likelihood(10.0, 1000, NUMBERS))
    assert weight.at(551.0, 0, 0) - weight.of(at_noise) == pytest.approx(
        -1.0 / (1.0 + 20.0 / 30.0), rel=0.05
    )


def test_all_candidates_of_a_kind_have_the_stated_odds_together():
    """However long the lists are, so many effects are expected, and the odds of one that no list has are the same."""
    numbers = dataclasses.replace(NUMBERS, expected=1.5, unknown_odds=0.2)
    for named, free in ((3, 2), (40, 25)):
        weight = Weighing(named, free, 1000, numbers)
        weight.note(a_set(1.0))
        of_named, of_free = (np.exp(weight.at(550.0, *one) - weight.at(550.0, 0, 0)) for one in ((1, 0), (0, 1)))
        assert named * of_named == pytest.approx(1.5) and free * of_free == pytest.approx(0.2)
        assert weight.at(550.0, 2, 1) - weight.at(550.0, 0, 0) == pytest.approx(np.log(of_named**2 * of_free))


def test_what_a_set_explains_decides_how_much_its_laws_may_leave():
    """Beside a cause that explains much, a fall of the misfit that is far below a hundredth of it counts little."""
    gains = []
    for of_nothing in (2e3, 2e6):
        weight = Weighing(1, 1, 1000, NUMBERS)
        weight.note(FittedSet((), None, None, of_nothing, 60.0, of_nothing, 1000))
        weight.note(dataclasses.replace(a_set(1.0, EddyDrag), misfit=550.0, numbers=60.0, excess=0.0))
        gains.append(weight.at(550.0, 0, 0) - weight.at(570.0, 0, 0))
    assert gains[0] > 5.0 and 0.0 < gains[1] < 0.1


def test_laws_that_follow_the_library_leave_little_elsewhere():
    """The same fall counts where the deviations of the laws explain next to nothing."""
    gains = []
    for fall in (np.inf, 3e4, 100.0, 0.0):
        weight = Weighing(1, 1, 1000, NUMBERS)
        weight.note(FittedSet((), None, None, 2e6, 60.0, 2e6, 1000))
        best = dataclasses.replace(a_set(1.0, EddyDrag), misfit=550.0, numbers=60.0, fall_by_laws=fall)
        weight.note(best)
        weight.note(dataclasses.replace(best, misfit=900.0, fall_by_laws=0.0))  # one that leaves more says nothing
        gains.append(weight.at(550.0, 0, 0) - weight.at(2000.0, 0, 0))
    assert gains[0] == gains[1] < 2.0 and 5.0 < gains[2] < gains[3]


@pytest.mark.parametrize("effects", [(), (InverterDeadTime(dead_time_voltage=0.5), CoggingForce())])
def test_the_hidden_effects_are_the_most_probable_set(effects):
    truth = structs.replace(bench(), effects=(*bench().effects, *effects))
    found = diagnose(measured(empty_campaign(), truth), LIBRARY).posterior
    assert found.sets[0].key == {effect.id for effect in effects}
    assert found.weights[0] > 0.5


def test_a_best_fit_is_not_gone_on_for_ever_where_only_its_cost_falls(monkeypatch):
    """What its numbers cost may rise by more than ½χ² falls: then the known fit stays, and is at its end."""

    def fitted(cost, misfit):
        fit = types.SimpleNamespace(cost=cost, converged=False, x=np.zeros(1))
        return FittedSet((Candidate(EddyDrag),), types.SimpleNamespace(fit=fit), None, misfit, 60.0, 1000.0, 1000)

    search, known, again = SetSearch.__new__(SetSearch), fitted(2000.0, 2000.0), fitted(1900.0, 2010.0)
    search.sets, search.weight, search._at_their_ends, calls = {known.key: known}, Weighing(1, 1, 1000), [], []

    def fits(jobs):
        calls.extend(jobs)
        assert len(calls) < 3
        return [(jobs[0], again)]

    monkeypatch.setattr(search, "_fits", fits)
    search.weight.note(known)
    search._go_on()
    assert len(calls) == 1 and search.sets[known.key] is known


def test_effects_of_the_component_of_a_free_curve_are_fitted_in_its_place_but_no_other_curve():
    """However little their signatures predict: far from the calibrated model a law may do far more."""

    def curve_of(variable):
        place = LawPlace("supply_voltage_change", variable)
        return CurveCandidate(tabulated_class(f"curve_over_{variable}", place, 3), place=place, nodes=(-1.0, 0.0, 1.0))

    curve, empty = curve_of("current"), FittedSet((), None, None, 9000.0, 60.0, 8500.0, 1000)
    best = FittedSet((curve,), None, None, 600.0, 60.0, 10.0, 1000)
    search = SetSearch.__new__(SetSearch)
    search.sets, search.weight, search._failed = {of.key: of for of in (empty, best)}, Weighing(3, 3, 1000), set()
    added = [curve_of("voltage"), Candidate(CoggingForce), Candidate(SupplySag)]
    empty.moves, best.moves = [Move(empty, of, np.zeros(0), np.zeros(0), 10.0) for of in added], []
    for of in search.sets.values():
        search.weight.note(of)
    assert [move.added.name for move in search._moves(best)] == ["supply_sag"]


@pytest.mark.parametrize("excess, tried", [(3000.0, 2), (0.0, 0)])
def test_above_the_noise_two_additions_are_fitted_even_if_predicted_a_little_too_weak(excess, tried):
    """A signature may predict too little of what an effect does beside another one."""
    empty = FittedSet((), None, None, 90_000.0, 60.0, 89_000.0, 1000)
    best = FittedSet((Candidate(EddyDrag),), None, None, 4000.0, 60.0, excess, 1000)
    search = SetSearch.__new__(SetSearch)
    search.sets, search.weight, search._failed = {of.key: of for of in (empty, best)}, Weighing(47, 40, 1000), set()
    for of in search.sets.values():
        search.weight.note(of)
    kinds = (CoggingForce, SupplySag, InverterDeadTime)
    empty.moves = []
    best.moves = [Move(best, Candidate(kind), np.zeros(0), np.zeros(0), 1000.0 + k) for k, kind in enumerate(kinds)]
    shortfalls = [search.weight.of(best) - search._predicted(move) for move in best.moves]
    assert all(0.0 < shortfall < PREDICTION_ERROR for shortfall in shortfalls)
    assert [move.added.kind for move in search._moves(best)] == [InverterDeadTime, SupplySag][:tried]
