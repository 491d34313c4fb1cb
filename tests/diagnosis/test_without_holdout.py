"""Diagnosis of campaigns without hold-out runs, and of a law whose parameter the data do not determine."""

import dataclasses
import json

import jax.numpy as jnp
import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.calibration.fit import fit
from edhas_jax.diagnosis.planning import next_experiment
from edhas_jax.diagnosis.search import candidates
from edhas_jax.diagnosis.search.candidates import Candidate, at_prior_bound, build_problem
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.machine.effects import Effect, ForceConstantDroop, InverterDeadTime
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.campaign_writer import write_campaign
from edhas_jax.measurements.instruments import Instruments
from tests.support.synthetic_campaign import bench, empty_campaign, measured


class SteepDeadTime(Effect):
    """A dead time whose voltage rises with the current over a width that may be too small to matter."""

    dead_time: float = par(0.5, "V", (0.0, 10.0), "voltage that is lost", plausible=(0.1, 2.0))
    steepness: float = par(9.0, "1/A", (0.01, 1e4), "inverse width", plausible=(3.0, 30.0))

    def coil_voltage_change(self, s, z):
        return -self.dead_time * jnp.tanh(self.steepness * s.current)


def campaign_of(*hidden: Effect, runs: int = 1, length: int = 301):
    """The first runs of a campaign on a bench with hidden effects, all of them to be fitted."""
    truth = structs.replace(bench(), effects=(*bench().effects, *hidden))
    campaign = measured(empty_campaign(lengths=(length,) * 3), truth)
    return dataclasses.replace(campaign, runs=tuple(dataclasses.replace(r, use=Use.FIT) for r in campaign.runs[:runs]))


def test_the_only_run_is_divided_by_time(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(candidates, "LIBRARY", (InverterDeadTime,))
    monkeypatch.setattr(next_experiment, "next_experiment", lambda diagnosis: None)
    write_campaign(campaign_of(InverterDeadTime(dead_time_voltage=0.8)), tmp_path / "bench")
    assert main(["diagnose", str(tmp_path / "bench"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "nan" not in printed and "Residual over noise on the held-out part of the runs" in printed
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["verdict"] == "missing_effect" and found["effects"] == ["inverter_dead_time"]
    assert found["holdout_split"].startswith("No run of the campaign is held out. The run was divided by time: ")
    assert found["holdout_split"] in printed and found["candidates"][0]["probability"] > 0.95
    assert all(c["holdout_error"] > 0.5 for c in found["candidates"] if c["parameters"])
    assert found["error"]["after"]["holdout"]["overall"] == pytest.approx(1.0, abs=0.15)


def test_the_parts_of_a_run_keep_its_time_and_its_samples():
    campaign = campaign_of(runs=2)
    divided, sentence = split_for_holdout(campaign)
    assert [run.use for run in divided.runs] == [Use.FIT, Use.HOLDOUT] * 2 and "Each run" in sentence
    first, last, whole = divided.runs[0], divided.runs[1], campaign.runs[0]
    np.testing.assert_array_equal(np.concatenate([first.time, last.time]), whole.time)
    np.testing.assert_array_equal(np.concatenate([first.lines, last.lines]), whole.lines)
    for name, values in whole.signals.items():
        np.testing.assert_array_equal(np.concatenate([first.signals[name], last.signals[name]]), values)
    assert len(first.time) / len(whole.time) == pytest.approx(2.0 / 3.0, abs=0.01)


def test_only_runs_that_are_long_enough_are_divided_and_declared_ones_are_kept():
    short = campaign_of(length=21)
    assert split_for_holdout(short) == (short, "")
    declared = empty_campaign()
    assert split_for_holdout(declared) == (declared, "")


@pytest.mark.parametrize("droop, implausible", [(0.0, ["steepness"]), (1.0, [])])
def test_a_parameter_that_the_data_do_not_determine_discredits_no_effect(droop, implausible):
    """The true dead time is a step; the fitted one is as steep as its prior allows.

    Where the model is right otherwise, the data demand that steepness. Where another effect is missing too, its misfit
    is far larger than what a plausible steepness adds.
    """
    campaign = campaign_of(SteepDeadTime(dead_time=0.8, steepness=1e3), ForceConstantDroop(droop=droop), length=201)
    candidate = Candidate(SteepDeadTime)
    fitted = fit(build_problem(campaign, campaign.machine, Instruments(), (), candidate), starts=1)
    assert at_prior_bound(candidate, fitted) == ["steepness"]
    assert implausible_parameters(candidate, fitted) == implausible
