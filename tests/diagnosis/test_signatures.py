"""Signatures: a fit begins near the size that explains most, whichever way a parameter makes an effect large."""

import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import SignatureSimulator, signature_table, with_scaled_size
from edhas_jax.inference.fit.calibrated_model import calibrate
from edhas_jax.machine.effects import CoilHeating, InverterDeadTime, MagneticSaturation
from tests.support.synthetic_campaign import bench, empty_campaign, measured

SATURATION = 20.0  # A, of the bench; the model has none
FAST = (
    {"frequency": 10.0, "amplitude": 8e-3}, {"frequency": 30.0, "amplitude": 6e-3},
    {"frequency": 15.0, "amplitude": 2.5e-3},
)  # fmt: skip


@pytest.fixture(scope="module")
def calibrated():
    """The calibrated model of a bench whose motor saturates, and its time steps."""
    truth = structs.replace(bench(), effects=(*bench().effects, MagneticSaturation(saturation_current=SATURATION)))
    return calibrate(measured(empty_campaign(conditions=FAST), truth))


def test_a_signature_grows_or_vanishes_with_the_first_parameter(calibrated):
    """A larger dead time changes the signals more; a larger saturation current or heat capacity changes them less."""
    simulator = SignatureSimulator(calibrated[0].fit)
    kinds = InverterDeadTime, MagneticSaturation, CoilHeating
    exponents = [simulator.signatures(Candidate(kind)).exponent for kind in kinds]
    assert exponents[0] == pytest.approx(1.0, abs=0.2)
    assert exponents[1] <= -0.5 and exponents[2] <= -0.5


def test_a_smaller_signature_of_a_saturation_has_a_larger_current(calibrated):
    (unknown,) = Candidate(MagneticSaturation).unknowns(calibrated[0].fit.problem.campaign)
    x = with_scaled_size([unknown], np.zeros(1), 0.25, -2.0)
    assert unknown.value(x[0]) == pytest.approx(2.0 * unknown.value(0.0))


def test_a_saturation_is_found_from_its_signatures(calibrated):
    model, resolution = calibrated
    table = signature_table(model.fit, [Candidate(MagneticSaturation)], print, with_free_terms=False)
    search = SetSearch(model, table, resolution, print)
    (move,) = search.additions()
    (unknown,) = Candidate(MagneticSaturation).unknowns(model.fit.problem.campaign)
    assert unknown.value(move.start[0]) == pytest.approx(SATURATION, rel=0.3)
    found = search.fit_of(move).evaluated
    assert found.fit.values["magnetic_saturation.saturation_current"] == pytest.approx(SATURATION, rel=0.01)
    assert found.excess < 1e-3 * model.excess


def test_beside_a_fitted_effect_the_other_signatures_are_those_at_its_fit(calibrated):
    """What a dead time changes depends on the force of the motor, so on its saturation."""
    model, resolution = calibrated
    candidates = [Candidate(MagneticSaturation), Candidate(InverterDeadTime)]
    table = signature_table(model.fit, candidates, print, with_free_terms=False)
    search = SetSearch(model, table, resolution, print)
    (move,) = (move for move in search.additions() if move.added == candidates[0])
    found = search.fit_of(move)
    beside = table.at(found.evaluated.fit, found.key)
    assert [of.candidate for of in beside.candidates] == candidates[1:]
    there = signature_table(found.evaluated.fit, candidates[1:], print, with_free_terms=False)
    np.testing.assert_array_equal(beside.rows[0], there.rows[0])
    np.testing.assert_array_equal(beside.candidates[0].rows, beside.rows[0])
    before = table.candidates[1].rows
    assert np.linalg.norm(beside.rows[0] - before) > 0.01 * np.linalg.norm(before)
