"""Diagnosis of campaigns without hold-out runs."""

import dataclasses
import json

import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates import candidate
from edhas_jax.diagnosis.planning import next_experiment
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.posterior import NOT_FITTED
from edhas_jax.machine.effects import Effect, InverterDeadTime
from edhas_jax.measurements.campaign import Use
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured


def campaign_of(*hidden: Effect, runs: int = 1, length: int = 301):
    """The first runs of a campaign on a bench with hidden effects, all of them to be fitted."""
    truth = structs.replace(bench(), effects=(*bench().effects, *hidden))
    campaign = measured(empty_campaign(lengths=(length,) * 3), truth)
    return dataclasses.replace(campaign, runs=tuple(dataclasses.replace(r, use=Use.FIT) for r in campaign.runs[:runs]))


def test_the_only_run_is_divided_by_time(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(candidate, "LIBRARY", (InverterDeadTime,))
    monkeypatch.setattr(next_experiment, "next_experiment", lambda diagnosis: None)
    write_campaign(campaign_of(InverterDeadTime(dead_time_voltage=0.8)), tmp_path / "bench")
    assert main(["diagnose", str(tmp_path / "bench"), "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "nan" not in printed and "Residual over noise on the held-out part of the runs" in printed
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert found["verdict"] == "missing_effect" and found["effects"] == ["inverter_dead_time"]
    assert found["holdout_split"].startswith("No run of the campaign is held out. The run was divided by time: ")
    assert found["holdout_split"] in printed and found["candidates"][0]["probability"] > 0.9 * (1.0 - NOT_FITTED)
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
