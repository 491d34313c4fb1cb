"""Effects chosen by hand: those that are absent come to nothing and are said so, weak ones get their size."""

import dataclasses
import math
import re

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.core.units import estimate_text
from edhas_jax.diagnosis.candidates.candidate import Candidate, from_absence
from edhas_jax.diagnosis.search.chosen_effects import calibrated_model, fit_with_effects, with_effect
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import signature_table
from edhas_jax.inference.fit.calibration import estimates_as_json
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import (
    LIBRARY,
    EddyDrag,
    Effect,
    ForceConstantDroop,
    InverterDeadTime,
    LugreFriction,
    MagneticSaturation,
    ParasiticSpring,
)
from edhas_jax.measurements.sensor_models import SensorOffset
from edhas_jax.tasks.add import AddResult
from edhas_jax.tasks.add import add as edhas_add
from tests.support.synthetic_campaign import bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}


def campaign_of(*effects):
    machine = edhas.change(bench(), **TRUTH)
    return measured(empty_campaign(), structs.replace(machine, effects=(*machine.effects, *effects)))


def sizes(model):
    """(value, standard error, limit) by the name of the parameter alone."""
    rows = model.as_json()["parameters"].items()
    return {name.split(".")[1]: (row["value"], row["std"], row.get("limit")) for name, row in rows}


@pytest.fixture(scope="module")
def calibrated():
    """The calibrated model of a campaign whose machine has no further effect."""
    campaign = campaign_of()
    return campaign, calibrated_model(campaign)


@pytest.mark.parametrize("kind", [InverterDeadTime, ParasiticSpring, EddyDrag, ForceConstantDroop])
def test_an_absent_effect_comes_to_nothing_and_the_fit_is_no_worse(calibrated, kind):
    campaign, before = calibrated
    model = with_effect(campaign, before, kind)
    size, error, limit = next(iter(sizes(model).values()))
    assert (size, error, limit) == (0.0, None, "lower") or abs(size) < 3.0 * error
    assert model.evaluated.cost < before.evaluated.cost + 0.5
    assert model.needs_no_effect.startswith(f"The model without {kind.id} is as good")


def test_a_size_at_a_limit_names_it_and_has_no_error(calibrated):
    campaign, before = calibrated
    model = with_effect(campaign, before, ParasiticSpring)
    fit: Fit = model.evaluated.fit
    (name,) = fit.at_limit
    assert fit.text(name) == "0 N/m, its lower limit" and fit.interval_text(name) == "at its lower limit"
    assert math.isnan(fit.standard_errors[name]) and all(map(math.isnan, fit.interval(name)))
    assert estimates_as_json(fit)[name] == {"value": 0.0, "std": None, "unit": "N/m", "limit": "lower"}
    table = AddResult(campaign, (before, model)).summary().tables["estimates"]
    assert table.rows == ((name, "0 N/m, its lower limit"),)


def test_that_an_effect_is_needless_is_said_first(calibrated):
    campaign, _ = calibrated
    summary = edhas_add(campaign, [InverterDeadTime]).summary()
    assert summary.sentences[0] == str(summary).split("\n\n")[1]
    assert re.search(r"(0\.99\d) without and \1 with it on the fitted runs", summary.sentences[0])


def test_a_size_at_its_bound_has_no_error(calibrated):
    """The search fits sizes on logarithmic scales, whose bound is no estimate."""
    campaign, before = calibrated
    fit = before.evaluated.fit
    table = signature_table(fit, [Candidate(InverterDeadTime)], print, with_free_terms=False)
    search = SetSearch(before.evaluated, table, before.resolution, print)
    found = search.fit_of(search.additions()[0])
    (row,) = (v for n, v in estimates_as_json(found.evaluated.fit).items() if n.startswith("inverter"))
    assert row["std"] is None and row["limit"] == "lower"


@pytest.mark.parametrize(
    ("effect", "name", "truth"),
    [(InverterDeadTime(dead_time_voltage=0.05), "dead_time_voltage", 0.05),
     (ForceConstantDroop(droop=-0.1), "droop", -0.1)],
)  # fmt: skip
def test_a_size_below_its_plausible_range_or_of_the_other_sign_is_found(effect, name, truth):
    before, model = fit_with_effects(campaign_of(effect), [type(effect)])
    value, error, _ = sizes(model)[name]
    assert abs(value - truth) < 3.0 * error < 0.5 * abs(truth)
    assert not model.needs_no_effect and before.needs_no_effect == ""


def test_an_effect_that_only_imitated_another_one_comes_to_nothing_beside_it():
    campaign = campaign_of(InverterDeadTime(dead_time_voltage=0.8))
    _, imitating, both = fit_with_effects(campaign, [ParasiticSpring, InverterDeadTime])
    assert sizes(imitating)["spring_rate"][0] > 100.0
    assert sizes(both)["spring_rate"] == (0.0, None, "lower")
    value, error, _ = sizes(both)["dead_time_voltage"]
    assert abs(value - 0.8) < 3.0 * error < 0.02


def test_a_size_that_fades_as_it_grows_reaches_the_end_of_its_span():
    """The influence of a saturation vanishes with 1/current, which is about linear on the scale of the size."""
    (p,), campaign = Candidate(MagneticSaturation).sizes(), empty_campaign()
    (u,) = Candidate(MagneticSaturation).unknowns(campaign)
    freed = from_absence(u, p.span, fades=True)
    low, high = freed.bounds()
    assert freed.value(low) == pytest.approx(p.span[1]) and freed.value(high) == pytest.approx(u.span[0])
    assert high == pytest.approx(3.0) and freed.coordinate(freed.value(1.7)) == pytest.approx(1.7)
    e = 1e-6
    assert freed.derivative(1.7) == pytest.approx((freed.value(1.7 + e) - freed.value(1.7 - e)) / (2.0 * e))


def test_sizes_vanish_together():
    assert [p.name for p in Candidate(LugreFriction).sizes()] == [
        "coulomb_friction", "static_friction", "bristle_damping", "viscous_friction"
    ]  # fmt: skip
    assert [p.name for p in Candidate(EddyDrag).sizes()] == ["eddy_coefficient"]
    for kind in LIBRARY:
        assert not Candidate(kind).free_parameters() or Candidate(kind).sizes()


def test_the_prior_of_a_sensor_offset_is_five_percent_of_the_range_of_its_signal():
    campaign, candidate = campaign_of(), Candidate(SensorOffset, "current")
    (offset,) = candidate.unknowns(campaign)
    extent = np.ptp(np.concatenate([run.signals["current"] for run in campaign.runs]))
    assert (offset.centre, offset.spread) == (0.0, pytest.approx(0.05 * extent, rel=1e-12))
    assert candidate.unit(offset, campaign.machine) == "A" and offset.unit == "-"


class Shim(Effect):
    """A force whose parameter has the name of that of a sensor offset."""

    offset: float = par(0.0, "N", (-1e3, 1e3), "force")

    def mover_force(self, s, z):
        return self.offset


def test_an_effect_with_a_parameter_of_that_name_is_no_sensor_fault():
    assert Candidate(Shim).free_parameters() == [] == Candidate(Shim).unknowns(empty_campaign())


def test_texts_of_estimates():
    assert estimate_text(0.8002, 3.8e-4, "V") == "0.80020 ± 0.00038 V"
    assert estimate_text(0.0, None, "V", "lower") == "0 V, its lower limit"


def test_a_wide_prior_does_not_make_an_estimate_lie_at_a_limit(calibrated):
    """Its bounds are close together in coordinates."""
    fit = calibrated[1].evaluated.fit
    unknowns = tuple(dataclasses.replace(u, spread=1e9 * u.spread) for u in fit.problem.unknowns)
    wide = dataclasses.replace(fit, problem=dataclasses.replace(fit.problem, unknowns=unknowns), x=1e-9 * fit.x)
    assert wide.at_limit == {} and wide.values == pytest.approx(fit.values)
