"""A fit says which combinations the data do not determine, and what its standard errors take for granted."""

import dataclasses
import json

import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.inference.fit.calibration import Calibration, save_calibration
from edhas_jax.inference.fit.confounding import assumed_parameters, weak_combinations
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.measurements.campaign import Spread
from edhas_jax.measurements.unknown_parameters import unknown_around
from tests.support.synthetic_campaign import bench, empty_campaign, measured


@pytest.fixture(scope="module")
def campaign():
    """Position and current only: force constant, mass and friction have a common factor that these do not show."""
    campaign = measured(empty_campaign(), bench())
    kept = ("piston_position", "current")
    channels = {n: campaign.channels[n] for n in kept}
    runs = [dataclasses.replace(run, signals={n: run.signals[n] for n in kept}) for run in campaign.runs]
    return dataclasses.replace(campaign, channels=channels, runs=tuple(runs))


def fitted(campaign, *names):
    unknowns = tuple(unknown_around(campaign.machine, name, Spread(0.1)) for name in names)
    return fit(FitProblem(campaign, campaign.machine, unknowns), starts=1)


def test_force_mass_and_friction_can_change_together(campaign, tmp_path):
    result = fitted(campaign, "force_constant", "mover_mass", "mover_damping", "coulomb_friction", "static_friction")
    (first, *_) = weak_combinations(result)
    assert {"force_constant", "mover_mass"} <= set(first.changes)
    shares = [first.relative[name] for name in ("force_constant", "mover_mass")]
    assert shares[0] == pytest.approx(shares[1], rel=0.2) and abs(shares[0]) > 0.005
    assert "can change together by" in first.sentence()
    # the change is invisible: it costs about as much as one standard error does
    noise = {run.name: {"current": np.ones(9)} for run in campaign.runs}
    calibration = Calibration(result, None, (), noise, noise, 0.0)
    assert first.sentence() in calibration.findings()
    save_calibration(calibration, tmp_path)
    (stored, *_) = json.loads((tmp_path / "fit.json").read_text())["not_determined"]
    assert stored["relative"] == pytest.approx(first.relative)


def test_a_parameter_taken_as_known_that_the_unknowns_would_hide_is_named():
    """Viscous friction and damping of the mover are the same force."""
    empty = empty_campaign(structs.replace(bench(), effects=(LugreFriction(viscous_friction=20.0),)), uncertain={})
    channels = {n: dataclasses.replace(c, noise=0.1 * c.noise) for n, c in empty.channels.items()}
    campaign = measured(dataclasses.replace(empty, channels=channels), empty.machine)
    result = fitted(campaign, "mover_damping")
    friction = {a.name: a for a in assumed_parameters(result)}["viscous_friction"]
    assert friction.shifts["mover_damping"] == pytest.approx(-20.0 * friction.change, rel=0.1)
    assert friction.hidden_share > 0.95 and abs(friction.shifts_over_error["mover_damping"]) > 3.0
    assert "take viscous_friction as exactly known" in friction.sentence()


def test_a_determined_parameter_is_in_no_combination(campaign):
    assert not weak_combinations(fitted(campaign, "force_constant", "coil_resistance"))


def test_remaining_residuals_make_the_standard_errors_too_small(campaign):
    result = fitted(campaign, "force_constant", "coil_resistance")
    noise = {run.name: {"current": np.full(9, 3.0)} for run in campaign.runs}
    sentences = Calibration(result, None, (), noise, noise, 0.0).findings()
    assert any("The residual is 3.0 times the noise" in sentence for sentence in sentences)
