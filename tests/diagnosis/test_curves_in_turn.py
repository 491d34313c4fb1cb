"""Curves one after another: two things that act at two places of a machine of one's own are both found."""

import dataclasses
import itertools
from pathlib import Path

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax import Effect, Recorded
from edhas_jax.diagnosis.chosen_effects import calibrated_model
from edhas_jax.diagnosis.search.free_curves import add_curves_in_turn
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.tanks.rig import TwoTanks

INTERVAL, COUNT = 4.0, 700


class TwoLeaks(Effect, rig=TwoTanks):
    """A leak of either tank in proportion to its level."""

    def upper_loss(self, s, z):
        return 4e-3 * s.upper_level

    def lower_loss(self, s, z):
        return 6e-3 * s.lower_level


@pytest.fixture(scope="module")
def campaign():
    rng = np.random.default_rng(4)
    time = INTERVAL * np.arange(COUNT)
    voltage = np.interp(time, time[::25], 3.0 + 0.9 * rng.normal(size=len(time[::25])))
    drives = {"pump_voltage": Recorded(values=np.clip(voltage, 1.5, 5.5), interval=INTERVAL)}
    run = BenchRun("run", Path("run.csv"), Use.FIT, {}, time, {}, np.arange(COUNT) + 2, None, drives)
    # both levels are measured, so that both places can be told apart
    channels = {name: Channel("V", 0.01) for name in ("level", "upper_level")}
    exact = {name: SensorAccuracy(gain=1e-9, offset=1e-9, shift=1e-9) for name in channels}
    accuracy = BenchAccuracy(trigger=1e-3, recorder_filter=0.0, signals=exact)
    uncertain = {"pump_gain": 0.001, "outlet": 0.001}
    found = Campaign("tanks", Path("."), TwoTanks(), uncertain, channels, (run,), (), stated_accuracy=accuracy)
    truth = TwoTanks(effects=(TwoLeaks(),))
    exact_signals = MeasurementModel(found, truth, (), (run,)).predict_all_runs(np.zeros(0), 4)[0].values
    signals = {name: values + 0.01 * rng.normal(size=COUNT) for name, values in exact_signals.items()}
    return checked_campaign(dataclasses.replace(found, runs=(dataclasses.replace(run, signals=signals),)))


def test_both_places_are_found_one_after_the_other(campaign):
    before = calibrated_model(campaign)
    curves, models = zip(*add_curves_in_turn(before.evaluated, (), before.resolution), strict=True)
    assert {curve.place.slot for curve in curves[:2]} == {"upper_loss", "lower_loss"}
    excesses = [before.evaluated.excess, *(model.excess for model in models)]
    assert all(after < earlier for earlier, after in itertools.pairwise(excesses))
    assert excesses[2] < 0.01 * excesses[0], "one curve alone leaves much"
    assert excesses[1] > 0.1 * excesses[0]
    last = models[-1].fit
    machine = edhas.change(last.machine, **last.values)
    assert [effect.id for effect in machine.effects] == [curve.id for curve in curves]
    curve = next(curve for curve in curves if curve.place.slot == "upper_loss")
    table = curve.table(last)
    assert np.polyfit(table.nodes[3:-3], table.values[3:-3], 1)[0] == pytest.approx(4e-3, rel=0.3)


def test_nothing_is_added_to_a_complete_model(campaign):
    complete = dataclasses.replace(campaign, machine=TwoTanks(effects=(TwoLeaks(),)))
    before = calibrated_model(complete)
    assert add_curves_in_turn(before.evaluated, (), before.resolution) == []
