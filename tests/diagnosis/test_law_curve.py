"""Laws estimated as free curves: known laws are found again, and the files of the model with a curve can be used.

A curve may be zero up to some level and rise from there (a hinge). That level is found; for a curve that acts over its
whole range, none is given.
"""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.config.law_file import read_law_file
from edhas_jax.config.machine_config import read_config
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.candidates.law_deviation import deviation_of, law_at_nodes, law_deviation, law_size
from edhas_jax.diagnosis.laws.added_terms import AddedTerm, added_slopes
from edhas_jax.diagnosis.laws.curve_figure import draw_law_curve
from edhas_jax.diagnosis.laws.curve_fit import estimate_free_curve, estimate_law_curve, exact_steps
from edhas_jax.diagnosis.laws.curve_onset import is_smooth, onset
from edhas_jax.diagnosis.laws.curve_prior import CurvePrior
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import samples_at_slots
from edhas_jax.diagnosis.laws.model_files import write_curve_model
from edhas_jax.inference.fit.calibration import campaign_residuals
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.machine.effects import (
    LIBRARY,
    ConstantBiasForce,
    DeliverySeatLeakage,
    InverterDeadTime,
    LugreFriction,
)
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable, table_of, tabulated_class
from edhas_jax.machine.rigs import RIGS, PumpBench
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.residuals import OVERALL, rms_by_signal
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter, uncertain_unknowns
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

POSITION = LawPlace("mover_force", "piston_position")
NODES = 1e-3 * np.array([-3.2, -2.4, -1.6, -0.8, 0.0, 0.8, 1.6, 2.4, 3.2])
FORCE = np.array([0.0, 0.6, -0.9, 1.2, 0.3, -1.0, 0.8, -0.4, 0.5])  # N
LOST = 0.8  # V
WIDTH = 0.15  # A


def with_effect(machine, effect):
    return structs.replace(machine, effects=(*machine.effects, effect))


def fitted(campaign, machine=None, more=()):
    machine = campaign.machine if machine is None else machine
    problem = FitProblem(campaign, machine, (*uncertain_unknowns(campaign, machine), *more))
    return fit(problem, np.zeros((1, len(problem.unknowns))), search=False)


def held_out(campaign, found, use=Use.HOLDOUT):
    """The rms residual over noise on the runs of a use."""
    residuals = campaign_residuals(campaign, found.machine, found.instruments, exact_steps(found))
    return rms_by_signal(campaign, residuals, use)[OVERALL]


@pytest.fixture(scope="module")
def bumps():
    """A bench with a force over the position that nobody knows of, the fit without it, and the curve."""
    truth = with_effect(bench(), LawTable("bumps", POSITION, NODES, FORCE).effect())
    campaign = measured(empty_campaign(), truth)
    without = fitted(campaign)
    return campaign, without, estimate_free_curve(without, POSITION, NODES)


@pytest.fixture(scope="module")
def dead_time():
    """A dead time by another law than the library's, the fit with the library's, and the curve."""
    x = np.concatenate([-np.geomspace(6.0, 0.02, 15), [0.0], np.geomspace(0.02, 6.0, 15)])
    voltage = -LOST * 2.0 / np.pi * np.arctan(x / WIDTH)
    truth = with_effect(bench(), LawTable("lost", LawPlace("coil_voltage_change", "current"), x, voltage).effect())
    campaign = measured(empty_campaign(), truth)
    size = UnknownParameter("dead_time_voltage", 0.9, 0.5, "V", (0.1, 3.0))
    with_law = fitted(campaign, with_effect(bench(), InverterDeadTime()), (size,))
    return campaign, with_law, estimate_law_curve(with_law, "inverter_dead_time")


def test_an_unknown_law_is_found_again(bumps):
    campaign, without, (curve, found) = bumps
    assert (curve.name, curve.place, curve.beside) == ("mover_force_curve", POSITION, "")
    inside = slice(1, -1)  # the outermost nodes are hardly visited
    error = curve.values - FORCE
    assert (np.abs(error) < 4.0 * curve.std + 0.01)[inside].all()
    assert np.sqrt(np.mean(error[inside] ** 2)) < 0.05 * np.ptp(FORCE) and curve.std[inside].max() < 0.1
    assert curve.log_evidence_gain > 100.0 and curve.explained_share is None
    assert held_out(campaign, without) > 1.5 and held_out(campaign, found) == pytest.approx(1.0, abs=0.06)
    assert table_of(found.machine.effects[-1]).values == pytest.approx(curve.values)


def test_nothing_is_found_where_nothing_is_missing():
    campaign = measured(empty_campaign(), bench())
    curve = estimate_free_curve(fitted(campaign), POSITION).curve
    assert curve.log_evidence_gain < 3.0
    assert (np.abs(curve.values) < 4.0 * curve.std + 1e-3).all() and np.abs(curve.values).max() < 0.1


def test_a_law_that_differs_is_replaced(dead_time):
    campaign, with_law, (curve, found) = dead_time
    assert curve.place == LawPlace("coil_voltage_change", "current") and curve.beside == ""
    assert [e.id for e in found.machine.effects] == ["lugre_friction", "inverter_dead_time_curve"]
    assert "dead_time_voltage" not in found.values and "coil_resistance" in found.values
    truth = -LOST * 2.0 / np.pi * np.arctan(curve.nodes / WIDTH)
    assert (np.abs(curve.total - truth) < 4.0 * curve.std + 0.03 * LOST).all()
    error, before = (np.sqrt(np.mean((v - truth) ** 2)) for v in (curve.total, curve.law_values))
    assert error < 0.35 * before
    assert 0.8 < curve.explained_share < 0.95  # the resistance reproduces the linear part of both laws
    assert held_out(campaign, found) < held_out(campaign, with_law) - 0.05
    assert held_out(campaign, found) == pytest.approx(1.0, abs=0.06)


def test_a_law_of_one_variable_deviates_over_that_one_only(dead_time):
    _, with_law, _ = dead_time
    by_variable = {
        place.variable: law_size(with_law, Candidate(InverterDeadTime), place)
        for place in law_places(with_law.machine, "coil_voltage_change")
    }
    assert by_variable.pop("current") == pytest.approx(with_law.values["dead_time_voltage"], rel=0.05)
    assert by_variable and not any(by_variable.values())
    assert law_size(with_law, Candidate(InverterDeadTime), POSITION) is None  # elsewhere
    # friction depends on the past of its bristles too: a curve over any variable may be a part of it
    friction = law_size(with_law, Candidate(LugreFriction), LawPlace("mover_force", "piston_velocity"))
    assert friction == pytest.approx(law_size(with_law, Candidate(LugreFriction), POSITION)) and friction > 0.0


def test_the_law_at_the_nodes_of_a_curve_is_that_of_the_effect(dead_time):
    """The nodes are those of another fit; outside of the range that a fit has seen, the law goes on as at its end."""
    _, with_law, _ = dead_time
    candidate, current = Candidate(InverterDeadTime), LawPlace("coil_voltage_change", "current")
    (effect,) = (e for e in with_law.machine.effects if e.id == "inverter_dead_time")

    def curve(place, nodes):
        return CurveCandidate(tabulated_class("curve", place, len(nodes)), None, place, 1.0, tuple(nodes))

    nodes = np.array([-1.7, -0.6, -0.2, -0.05, 0.0, 0.03, 0.11, 0.9, 1.6])
    law, size = law_at_nodes(with_law, candidate, curve(current, nodes))
    own = np.array([float(effect.coil_voltage_change(SimpleNamespace(current=i), None)) for i in nodes])
    np.testing.assert_allclose(law, own, atol=0.05 * np.abs(own).max())
    assert size == pytest.approx(with_law.values["dead_time_voltage"], rel=0.05)
    for place in (POSITION, LawPlace("coil_voltage_change", "piston_position")):
        assert law_at_nodes(with_law, candidate, curve(place, nodes)) is None
    # friction depends on its bristles too, so that no curve alone can be its law
    assert law_at_nodes(with_law, Candidate(LugreFriction), curve(POSITION, nodes)) is None


def test_a_curve_times_a_signal_is_as_large_as_the_law_where_that_signal_has_its_rms_value(dead_time):
    """The friction as a curve over the position times the speed is a damping: a force over a speed."""
    _, with_law, _ = dead_time
    friction = Candidate(LugreFriction)
    places = law_places(with_law.machine, "mover_friction")
    force = law_size(with_law, friction, next(place for place in places if not place.factors))
    products = [place for place in places if place.factors]
    assert products and force > 0.0
    for place in products:
        values = samples_at_slots(with_law, (place,), friction.id)[place.slot].values
        factor = np.prod([values[name] for name in place.factors], axis=0)
        assert law_size(with_law, friction, place) * np.sqrt(np.mean(factor**2)) == pytest.approx(force)


def test_a_law_may_deviate_by_half_of_its_size_over_its_own_variable(dead_time):
    _, with_law, _ = dead_time
    found = law_deviation(with_law, Candidate(InverterDeadTime))
    assert found.place == LawPlace("coil_voltage_change", "current") and found.of == "inverter_dead_time"
    assert found.spread == pytest.approx(0.5 * with_law.values["dead_time_voltage"], rel=0.05)
    assert deviation_of(Candidate(InverterDeadTime), [found]) is found
    assert deviation_of(Candidate(LugreFriction), [found]) is None and law_deviation(with_law, found) is None


def test_columns_are_derivatives_of_the_signals(bumps):
    campaign, without, _ = bumps
    table = LawTable("curve", POSITION, NODES, np.zeros(len(NODES)))
    values = [
        UnknownParameter(f"curve.value_{k}", 0.0, 1.0, "N", (-np.inf, np.inf), ParameterScale.LINEAR)
        for k in range(1, len(NODES) + 1)
    ]
    (slopes,) = added_slopes(without, [AddedTerm(table.effect(), values)])
    assert len(slopes) == len(campaign.runs_for(Use.FIT)) and slopes[0]["current"].shape == (401, len(NODES))
    k, step = 5, 1e-3
    ends = []
    for sign in (1.0, -1.0):
        machine = with_effect(without.machine, LawTable("x", POSITION, NODES, sign * step * np.eye(9)[k]).effect())
        model = MeasurementModel(campaign, machine, (), campaign.runs_for(Use.FIT))
        ends.append(model.predict_all_runs(np.zeros(0), without.resolution.coarse))
    for r, run in enumerate(slopes):
        for signal in ("voltage", "current", "piston_position"):
            difference = (ends[0][r].values[signal] - ends[1][r].values[signal]) / (2.0 * step)
            assert np.abs(run[signal][:, k] - difference).max() < 1e-3 * np.abs(difference).max()
    prior = CurvePrior(0.5, 0.2)
    factor = prior.factor(NODES)
    np.testing.assert_allclose(factor @ factor.T @ prior.precision(NODES), np.eye(len(NODES)), atol=1e-9)


def test_the_files_of_a_model_with_a_curve_are_used_by_the_commands(dead_time, tmp_path, monkeypatch, capsys):
    campaign, _, found = dead_time
    monkeypatch.chdir(tmp_path)
    write_campaign(campaign, tmp_path / "bench")
    files = write_curve_model(tmp_path / "model", found)
    table = read_law_file(files.law)
    assert table.place == found.curve.place and table.name == found.curve.name and "synthetic" in table.origin
    for read, written in ((table.nodes, found.curve.nodes), (table.values, found.curve.values)):
        np.testing.assert_allclose(read, written, rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(table.std, found.curve.std, rtol=1e-8)
    assert "effects: [lugre_friction, inverter_dead_time_curve.yaml]" in files.model.read_text()
    machine = read_config(files.model).machine
    assert table_of(machine.effects[-1]).values == pytest.approx(found.curve.values)
    assert main(["compare", "bench", "--model", str(files.model), "--out", "out"]) == 0
    figures = pd.read_csv(tmp_path / "out" / "figures.csv")
    assert len(figures) and "inverter_dead_time_curve" in (tmp_path / "out" / "report.html").read_text()
    quick = ["--set", "duration=0.05 s", "--no-figure", "--out", "run"]
    assert main(["simulate", str(files.model), *quick]) == 0
    assert "inverter_dead_time_curve" in capsys.readouterr().out
    again = read_config(tmp_path / "run" / "config.yaml").machine  # holds the table itself
    assert table_of(again.effects[-1]).values == pytest.approx(found.curve.values)


def test_the_figure_shows_curve_and_law_in_units(dead_time):
    figure = draw_law_curve(dead_time[2].curve, "inverter_dead_time")
    upper, lower = figure.axes
    assert upper.get_ylabel() == "coil voltage change, V" and lower.get_xlabel() == "current, A"
    assert len(upper.lines) >= 3 and len(upper.collections) >= 1


@pytest.fixture(scope="module")
def drag():
    """A bench with a drag that grows with the third power of the speed, of which nobody knows."""
    x = np.linspace(-0.5, 0.5, 9)
    law = LawTable("more", LawPlace("mover_friction", "piston_velocity"), x, 60.0 * x**3)
    return measured(empty_campaign(), with_effect(bench(), law.effect()))


def test_a_law_of_several_variables_stays_and_the_curve_is_added(drag):
    """Bristle friction depends on its state: what is added is the deviation from it."""
    curve, found = estimate_law_curve(fitted(drag), "lugre_friction")
    assert curve.beside == "lugre_friction" and curve.place.variable == "piston_velocity"
    assert [e.id for e in found.machine.effects] == ["lugre_friction", "lugre_friction_curve"]
    assert held_out(drag, found) == pytest.approx(1.0, abs=0.08)
    fast = np.abs(curve.nodes) > 0.1
    assert (np.sign(curve.total) == np.sign(curve.nodes))[fast].all()


def test_standard_errors_hold_what_the_other_unknowns_could_do(drag):
    """A linear part of a curve over the speed cannot be told from the damping, unless that is known."""
    place = LawPlace("mover_friction", "piston_velocity")
    known = dataclasses.replace(drag, uncertain={"coil_resistance": 0.02})
    free, alone = (estimate_free_curve(fitted(campaign), place).curve for campaign in (drag, known))
    assert alone.std[[1, -2]].max() < 0.5 * free.std[[1, -2]].min()
    assert (np.abs(alone.values - 60.0 * alone.nodes**3) < 4.0 * alone.std + 0.05)[1:-1].all()


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS)
def test_every_place_of_a_machine_can_have_a_curve(rig):
    slots = {slot.name for slot in rig.slots if law_places(rig(), slot.name)}
    assert slots <= {slot.name for slot in rig.slots} and {"mover_force", "coil_voltage_change"} <= slots
    assert law_places(rig(), "no_slot") == () and law_places(rig(), "coupling_force") == ()


def test_an_effect_without_a_law_over_a_signal_has_no_curve():
    campaign = measured(empty_campaign(), bench())
    machine = with_effect(bench(), ConstantBiasForce(bias_force=0.0))
    assert estimate_law_curve(fitted(campaign, machine), "constant_bias_force") is None
    assert {p.variable for p in law_places(PumpBench(effects=(LugreFriction(),)), "check_valve_force")} >= {"lift"}


def test_the_signal_with_which_a_constant_law_would_vary_is_known_at_its_slot():
    kinds = [kind for kind in LIBRARY if kind.varies_with]
    assert DeliverySeatLeakage in kinds
    for kind in kinds:
        places = law_places(PumpBench(effects=(kind(),)), kind.slots[0].name)
        assert kind.varies_with in {place.variable for place in places}


HINGE_NODES = np.linspace(3.0, 19.0, 11)
SPEEDS = np.linspace(-560.0, 430.0, 11)


@pytest.mark.parametrize("level", [8.0, 11.0, 14.0])
def test_a_hinge_begins_where_it_does(level):
    scatter = 0.01 * np.random.default_rng(0).normal(size=11)
    assert onset(HINGE_NODES, 0.05 * np.maximum(HINGE_NODES - level, 0.0) + scatter) == pytest.approx(level, abs=1.5)


@pytest.mark.parametrize("values", [
    0.3 * np.tanh(SPEEDS / 100.0) + 0.005 * SPEEDS,  # friction of a motor
    0.3 * np.tanh((SPEEDS + 400.0) / 100.0),
    0.005 * SPEEDS,
    np.where(SPEEDS < -500.0, -1.0, 0.002 * SPEEDS),
])  # fmt: skip
def test_a_curve_that_acts_everywhere_begins_nowhere(values):
    assert onset(SPEEDS, values) is None


def test_dry_friction_begins_nowhere():
    nodes = np.array([-105.0, -61.0, -35.0, -19.0, -9.6, -2.9, 2.9, 9.6, 19.0, 35.0, 61.0])  # near together around rest
    assert onset(nodes, 0.043 * np.sign(nodes)) is None


def test_a_curve_that_zigzags_is_not_smooth_and_real_laws_are():
    assert not is_smooth(np.array([-9.7, 0.6, -16.5, 6.1, 16.9, -7.7]))
    x = np.linspace(-1.0, 1.0, 9)
    stribeck = np.sign(x) * (1.0 + np.exp(-np.abs(x) / 0.1)) + 0.5 * x
    for law in (stribeck, np.maximum(x - 0.2, 0.0), np.sin(4.0 * x), np.abs(x), x, np.zeros(9)):
        assert is_smooth(law)
