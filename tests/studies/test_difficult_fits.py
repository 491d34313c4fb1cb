"""Benchmark campaigns that are difficult to fit: a coarse time step is misleading, or χ² has many local minima."""

import numpy as np

from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.inference.fit.calibrated_model import CALIBRATION_STEPS, calibrate, misfit_beyond_noise
from edhas_jax.inference.fit.evaluated_fit import find_minima
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.unpredictable_part import unpredictable_part
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.time_resolution import MAX_DERIVATIVE, choose_time_resolution
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Split


def campaign_of(family: str, number: int, split: Split = Split.TUNING) -> Campaign:
    """The campaign of a case, its data checked; some runs, or the last third of each run, are held out from fits."""
    return split_for_holdout(checked_campaign(draw(CaseKey(family, split, number)).campaign))[0]


def test_too_coarse_a_step_has_false_minima():
    """Three runs of the pump in which nothing is missing, and whose valves bounce."""
    campaign = campaign_of("f", 205)
    problem = calibration_problem(campaign)
    resolution = choose_time_resolution(problem.model(), np.zeros(len(problem.unknowns)))
    starts = np.clip(np.random.default_rng(0).normal(size=(8, len(problem.unknowns))), -2.0, 2.0)
    starts[0] = 0.0
    coarse, finer = (
        find_minima(problem, starts, factor * resolution.coarse, CALIBRATION_STEPS).model.cost for factor in (1, 2)
    )
    assert np.ptp(coarse) > 300.0 and np.ptp(finer) < 3.0  # nats
    calibrated, chosen = calibrate(campaign)
    assert misfit_beyond_noise(calibrated) == 0.0 and chosen.coarse == chosen.fine


def test_derivatives_of_a_cylinder_that_sticks_are_bounded():
    campaign = campaign_of("f", 200)
    problem = calibration_problem(campaign)
    model, x = problem.model(), np.zeros(len(problem.unknowns))
    resolution = choose_time_resolution(model, x)

    def largest(steps: int) -> float:
        found = model.predict_all_runs(x, steps, with_sensitivities=True)
        return max(np.abs(p.sensitivities[n]).max() / np.ptp(v) for p in found.values() for n, v in p.values.items())

    assert largest(resolution.coarse) < MAX_DERIVATIVE < 1e6 < largest(model.min_steps_per_sample())


def test_a_cylinder_that_sticks_makes_signals_irregular():
    """Neighbours of a point of the whole system scatter, those of a point of the pump do not."""
    scatter = []
    for family, number in (("f", 200), ("f", 205)):
        campaign = campaign_of(family, number)
        problem = calibration_problem(campaign)
        x = np.zeros(len(problem.unknowns))
        steps = choose_time_resolution(problem.model(), x).fine
        scatter.append(unpredictable_part(problem, x, steps, min_scatter=8.0))
    system, pump = scatter
    assert max(size / campaign_of("f", 200).channels[name].noise for name, size in system.items()) > 0.02
    assert pump == {}


def test_of_two_effects_that_imitate_each_other_the_plausible_one_stays():
    """The spring has another law than that of the library, and a cogging force of long pitch fits as well."""
    case = draw(CaseKey("f", Split.TUNING, 821))
    found = diagnose(case.campaign, case.library)
    assert [candidate.name for candidate in found.named] == ["parasitic_spring"]
    assert [law.differs for law in found.laws] == [True]
