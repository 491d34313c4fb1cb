"""Hidden effects found end to end: campaigns made by another integrator, what is answered, and that it helps."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.config.machine_config import read_config
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.laws.curve_basis import basis
from edhas_jax.diagnosis.laws.deviation import curve_columns
from edhas_jax.diagnosis.likelihood.bench_deviations import DeviationKind
from edhas_jax.diagnosis.report.result_file import save_diagnosis
from edhas_jax.diagnosis.search.backward_pass import take_back
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import EXCESS_SIGMAS
from edhas_jax.diagnosis.search.evaluated_fit import fit_coarse
from edhas_jax.diagnosis.search.forward_selection import diagnose
from edhas_jax.diagnosis.search.free_curves import free_curve
from edhas_jax.diagnosis.search.localisation import component_shares
from edhas_jax.diagnosis.search.result import Diagnosis, Round, Verdict
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.trial import Trial, try_candidate
from edhas_jax.machine.effects import (
    AsymmetricFriction,
    CoggingForce,
    Effect,
    ForceConstantDroop,
    InverterDeadTime,
    LugreFriction,
    MagneticSaturation,
    ParasiticSpring,
)
from edhas_jax.machine.effects.tabulated_law import LawPlace, table_of
from edhas_jax.measurements.campaign import Channel, Use
from edhas_jax.measurements.sensor_models import SensorLag
from edhas_jax.measurements.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise
from edhas_jax.measurements.time_resolution import TimeResolution

LIBRARY = (
    AsymmetricFriction, CoggingForce, ForceConstantDroop, InverterDeadTime, MagneticSaturation, ParasiticSpring
)  # fmt: skip
CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
UNCERTAIN = {"coil_resistance": 0.02, "force_constant": 0.02, "mover_damping": 0.25, "coulomb_friction": 0.25}
RUNS = tuple(
    PlannedRun(use, 0.2, {"frequency": frequency, "amplitude": amplitude})
    for use, frequency, amplitude in (
        (Use.FIT, 10.0, 3.5e-3), (Use.FIT, 25.0, 3e-3), (Use.FIT, 15.0, 4e-3), (Use.HOLDOUT, 20.0, 3.5e-3)
    )
)  # fmt: skip
DECISIVE = 12.0  # of evidence


class Windage(Effect):
    """Drag with the square of the speed, which the library does not have."""

    windage: float = par(25.0, "N*s^2/m^2", (0.0, 1e3), "drag per squared speed")

    def mover_force(self, s, z):
        return -self.windage * s.piston_velocity * jnp.abs(s.piston_velocity)


class SoftDeadTime(Effect):
    """A dead time that grows more slowly with the current than that of the library."""

    voltage: float = par(0.6, "V", (0.0, 5.0), "lost voltage")

    def coil_voltage_change(self, s, z):
        return -self.voltage * s.current / (jnp.abs(s.current) + 0.4)


def diagnosed(*hidden: Effect, chains=None, seed: int, on_progress=None) -> Diagnosis:
    """The diagnosis of an actuator bench on which `hidden` acts, and whose sensors have `chains`."""
    bench = edhas.ActuatorBench(reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(),))
    plan = planned_campaign("bench", bench, UNCERTAIN, CHANNELS, RUNS, 5e-4)
    rng = np.random.default_rng(seed)
    truth = draw_parameters(plan, bench, rng)
    truth = structs.replace(truth, effects=(*truth.effects, *hidden))
    return diagnose(synthesise(plan, truth, rng, chains), LIBRARY, on_progress=on_progress)


@pytest.fixture(scope="module")
def of_a_dead_time() -> Diagnosis:
    """The diagnosis of a bench whose amplifier has a dead time."""
    return diagnosed(InverterDeadTime(dead_time_voltage=0.8), seed=2)


@pytest.fixture(scope="module")
def of_windage() -> Diagnosis:
    """The diagnosis of a bench with a drag that the library does not have."""
    return diagnosed(Windage(windage=40.0), seed=4)


@pytest.fixture(scope="module")
def of_a_lagging_sensor() -> Diagnosis:
    """The diagnosis of a bench whose current sensor lags."""
    return diagnosed(chains={"current": (SensorLag(lag_time=1e-3),)}, seed=5)


def errors(found: Diagnosis) -> tuple[float, float, float]:
    """Residual over noise on the run that no fit has seen: before, calibrated, after."""
    return tuple(found.errors()[state]["holdout"]["overall"] for state in ("before", "calibrated", "after"))


def evidence(found: Diagnosis) -> str:
    """What every trial brought, for the message of a test that fails."""
    reported = [
        f"{t.candidate.name} {t.log_evidence_gain:.1f} of {t.score.predicted_gain:.1f}"
        for turn in found.rounds
        for t in turn.trials
    ]
    before = found.rounds[0].baseline.log_evidence
    return f"{found.verdict}, errors {errors(found)}, before {before:.2f}, trials {reported}"


def lead(found: Diagnosis, of: int = 0) -> float:
    """By how much evidence the accepted effect of a round beats the best of the others."""
    turn = found.rounds[of]
    rivals = [t.log_evidence_gain for t in turn.trials if t is not turn.accepted]
    tried = [t.candidate for t in turn.trials]
    promised = [score.predicted_gain for score in turn.scores if score.candidate not in tried]
    return turn.accepted.log_evidence_gain - max([0.0, *rivals, *promised])


def test_nothing_is_missing():
    found = diagnosed(seed=1)
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.ADEQUATE and not found.accepted, evidence(found)
    assert before > 2.0 and calibrated == after == pytest.approx(1.0, abs=0.05)
    assert found.ranked_candidates()[0][1] < 0.5


def test_an_effect_that_only_led_the_calibration_out_of_a_bad_point_is_taken_back():
    found = diagnosed(seed=1)
    fit = found.calibrated.fit
    bad = fit_coarse(fit.problem, fit.x + 1.5, fit.resolution.coarse, 0)
    score = ScoreTest(fit, ()).score(Candidate(InverterDeadTime))
    resolution = TimeResolution(fit.resolution.coarse, fit.resolution.coarse, 0.0)
    trial = try_candidate(found.calibrated, (), score, resolution, 12)
    trial = trial.with_fit(bad, trial.evaluated)
    assert trial.log_evidence_gain > 500.0
    rounds = [Round(bad, (score,), (trial,), trial), Round(trial.evaluated, (), (), None)]
    kept, members, rejected = take_back(rounds, resolution, lambda sentence: None)
    assert not members and len(kept) == 1 and kept[0].accepted is None
    assert [r.test.candidate.id for r in rejected] == ["inverter_dead_time"] and rejected[0].test.strength < 0.3
    assert kept[0].baseline.rms_over_noise(Use.HOLDOUT) == pytest.approx(1.0, abs=0.05)
    # what was taken out is still among the names, with the probability that its strength deserves
    (doubtful,) = dataclasses.replace(found, rejected=rejected).evidence.members
    assert doubtful.name == "inverter_dead_time" and doubtful.strength == rejected[0].test.strength
    assert not found.evidence.members


def test_the_model_without_the_only_effect_is_the_best_known_one(of_a_dead_time):
    first, last = of_a_dead_time.rounds
    resolution = TimeResolution(first.baseline.fit.resolution.coarse, first.baseline.fit.resolution.coarse, 0.0)
    poor = fit_coarse(first.baseline.fit.problem, first.baseline.fit.x + 3.0, resolution.coarse, 0)
    assert poor.cost > 1.1 * first.baseline.cost
    kept, members, _ = take_back([dataclasses.replace(first, baseline=poor), last], resolution, lambda sentence: None)
    assert [m.candidate.id for m in members] == ["inverter_dead_time"]
    assert kept[0].baseline.cost < 1.01 * first.baseline.cost


def test_one_effect(of_a_dead_time):
    found = of_a_dead_time
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, evidence(found)
    assert [t.candidate.id for t in found.accepted] == ["inverter_dead_time"]
    assert before > calibrated > 1.1 and after == pytest.approx(1.0, abs=0.05)
    assert lead(found) > DECISIVE
    assert found.ranked_candidates()[0][1] > 0.95 and next(iter(found.location_probabilities())) == "coil"
    name = "inverter_dead_time.dead_time_voltage"
    assert abs(found.final.values[name] - 0.8) < max(0.08, 2.0 * found.final.standard_errors[name])


def test_two_effects():
    found = diagnosed(ForceConstantDroop(droop=0.15), InverterDeadTime(dead_time_voltage=0.6), seed=3)
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, evidence(found)
    assert {t.candidate.id for t in found.accepted} == {"inverter_dead_time", "force_constant_droop"}
    assert before > calibrated > 1.1 and after == pytest.approx(1.0, abs=0.05)
    assert lead(found, 0) > DECISIVE and lead(found, 1) > DECISIVE


def test_a_law_that_differs_is_mounted_as_a_curve(tmp_path):
    found = diagnosed(SoftDeadTime(), seed=5)
    assert [t.candidate.id for t in found.accepted] == ["inverter_dead_time"], evidence(found)
    assert found.members[0].law_differs
    (law,) = found.laws
    assert law.of == "inverter_dead_time" and law.place == LawPlace("coil_voltage_change", "current")
    assert errors(found)[2] == pytest.approx(1.0, abs=0.05)
    fit, table = found.final, law.table(found.final)
    current = np.array([-2.0, -1.0, -0.5, 0.5, 1.0, 2.0])
    library = -fit.values["inverter_dead_time.dead_time_voltage"] * np.tanh(current / 0.05)
    true = -0.6 * current / (np.abs(current) + 0.4)
    # a part in proportion to the current is that of the resistance
    resistance = np.column_stack([current, library + basis(table.nodes, current) @ table.values - true])
    slope = resistance[:, 0] @ resistance[:, 1] / (current @ current)
    assert resistance[:, 1] - slope * current == pytest.approx(0.0, abs=0.03)
    save_diagnosis(found, tmp_path)
    written = read_config(tmp_path / "config.yaml").machine
    assert {effect.id for effect in written.effects} == {effect.id for effect in fit.machine.effects}
    assert table_of(written.effects[-1]).values == pytest.approx(table.values, rel=1e-6)


def test_an_effect_outside_the_library(of_windage):
    found = of_windage
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.UNKNOWN_EFFECT, evidence(found)
    assert before > calibrated > 1.1
    where = found.location_probabilities()
    assert next(iter(where)) == "mover" and where.get("sensor", 0.0) < 0.01 and where["mover"] > 0.5
    best = found.best_free_trial
    assert best.candidate.place == LawPlace("mover_force", "piston_velocity")
    table = best.candidate.table(best.evaluated.fit)
    # parts that are constant in size, or in proportion to the speed, are also those of uncertain parameters
    speed, drag = table.nodes, -40.0 * table.nodes * np.abs(table.nodes)
    columns = np.column_stack([speed, np.sign(speed)])
    difference = table.values - drag
    difference = difference - columns @ np.linalg.lstsq(columns, difference)[0]
    assert np.abs(difference).max() < 0.1 * np.abs(drag).max()
    assert best.evaluated.rms_over_noise(Use.HOLDOUT) == pytest.approx(1.0, abs=0.05)
    assert best.log_evidence_gain - max((t.log_evidence_gain for t in found.rounds[-1].trials), default=0.0) > DECISIVE


def test_the_score_of_a_curve_is_the_fall_with_its_columns(of_windage):
    calibrated = of_windage.calibrated
    curve = free_curve(calibrated.fit, LawPlace("mover_force", "piston_velocity"))
    columns = curve_columns(calibrated.fit, curve.place, np.array(curve.nodes))
    scaled = [{n: curve.spread * v for n, v in run.items()} for run in columns]
    score = ScoreTest(calibrated.fit, ()).score_columns(curve, scaled)
    with_best_parameters = calibrated.excess_with([{n: v[:, :0] for n, v in run.items()} for run in scaled])
    fall = with_best_parameters - calibrated.excess_with(scaled)
    assert 0.5 * score.chi_square_fall == pytest.approx(fall, rel=1e-6)


def test_the_share_of_a_component_is_what_its_candidates_explain_together(of_windage):
    calibrated = of_windage.calibrated
    candidate, test = Candidate(MagneticSaturation), ScoreTest(of_windage.calibrated.fit, ())
    score = test.score(candidate)
    _, fall, directions = test.joint_scores([candidate])
    shares = component_shares(test, calibrated, [candidate], [])
    misfit = 2.0 * (calibrated.excess + EXCESS_SIGMAS * np.sqrt(0.5 * calibrated.samples))
    assert list(shares) == ["mover"] and shares["mover"] == pytest.approx((fall - directions) / misfit)
    achieved = dataclasses.replace(Trial.failed(score), explained_share=0.9)
    share = component_shares(test, calibrated, [candidate], [achieved])["mover"]
    assert share == pytest.approx(0.9 * 2.0 * calibrated.excess / misfit)


def test_a_sensor_counts_as_far_as_what_remains_is_its_own(of_a_lagging_sensor):
    found = of_a_lagging_sensor
    calibrated, (trial,) = found.calibrated, found.accepted
    test = ScoreTest(calibrated.fit, ())

    def share(**added):
        rows = {
            run: {n: v + added.get(n, 0.0) for n, v in signals.items()}
            for run, signals in trial.evaluated.residuals.items()
        }
        changed = dataclasses.replace(trial, evaluated=dataclasses.replace(trial.evaluated, residuals=rows))
        return component_shares(test, calibrated, [], [changed])["sensor"] / trial.explained_share

    assert share(current=5.0) == pytest.approx(1.0, abs=0.02)
    assert share(current=5.0, voltage=5.0) == pytest.approx(0.5, abs=0.02)
    assert share(voltage=5.0) < 0.02


def test_what_candidates_take_up_together(of_windage):
    calibrated = of_windage.calibrated
    screen = ScoreTest(calibrated.fit, ())
    one, two = Candidate(AsymmetricFriction), Candidate(MagneticSaturation)
    scores = [screen.score(s) for s in (one, two)]
    alone = [score.chi_square_fall for score in scores]
    assert alone[1] > 0.0
    ranked, together, _ = screen.joint_scores([one, two])
    assert [score.chi_square_fall for score in ranked] == sorted(alone, reverse=True)
    # combinations that are small differences are not counted, so that a little may be lost
    assert 0.9 * max(alone) <= together <= screen.residual @ screen.residual
    assert screen.joint_scores([]) == ([], 0.0, 0)
    # a misfit that is nothing but the signature of a candidate is taken up by it, and not by another
    screen.residual = 100.0 * scores[1].direction
    assert 0.9e4 < screen.joint_scores([two])[1] <= 1.0001e4 and screen.joint_scores([one])[1] < 0.5e4


def test_a_sensor_that_lags(of_a_lagging_sensor):
    found = of_a_lagging_sensor
    before, calibrated, after = errors(found)
    assert found.verdict is Verdict.MISSING_EFFECT, evidence(found)
    assert [t.candidate.name for t in found.accepted] == ["sensor_lag on current"]
    assert before > calibrated > 1.05 and after == pytest.approx(1.0, abs=0.05)
    assert lead(found) > DECISIVE and next(iter(found.location_probabilities())) == "sensor"
    assert found.final.values["current.sensor_lag.lag_time"] == pytest.approx(1e-3, rel=0.05)


def test_an_unnecessary_correction_of_the_time_is_undone(of_a_lagging_sensor):
    """Without the lag the model fits better with all records shifted; with the lag no trigger deviates."""
    assert not any(map(any, of_a_lagging_sensor.final.problem.time_errors.values()))
    assert not [row for row in of_a_lagging_sensor.bench_deviations() if row.deviation.kind is DeviationKind.TRIGGER]
