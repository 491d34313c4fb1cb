"""Impossible samples have no weight anywhere, and the noise that is used is the measured one."""

import dataclasses
import json

import numpy as np
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.data_summary import data_sentences
from edhas_jax.measurements.checks.noise_measurement import measure_noise
from edhas_jax.measurements.comparison import compare
from edhas_jax.measurements.residual_patterns import find_patterns
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, modify_table, replace_in_yaml

PRESSURE = "outlet_pressure [MPa]"


@pytest.fixture(scope="module")
def valid():
    return checked_campaign(read_campaign(VALID_CAMPAIGN))


@pytest.fixture(scope="module")
def compared(valid):
    return compare(valid)


@pytest.fixture
def with_dropout(tmp_path):
    """The valid campaign with two samples of 0 MPa in one run."""
    folder = copy_campaign(tmp_path / "bench")

    def with_two_zeros(frame):
        frame.loc[700:701, PRESSURE] = 0.0

    modify_table(folder, "run3.csv", with_two_zeros)
    return folder


def test_two_bad_samples_do_not_change_a_comparison(with_dropout, compared):
    found = compare(read_campaign(with_dropout))
    values = found.campaign.runs[0].signals["outlet_pressure"]
    assert np.flatnonzero(np.isnan(values)).tolist() == [700, 701]
    expected = compared.rms_over_noise()
    for run, row in found.rms_over_noise().items():
        assert row == pytest.approx(expected[run], rel=0.01)
    sentences = [p.sentence for p in find_patterns(found)]
    assert sentences == [p.sentence for p in find_patterns(compared)]


def test_two_bad_samples_do_not_change_a_fit(with_dropout, valid):
    estimates = []
    for campaign in (valid, read_campaign(with_dropout)):
        problem = FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)[-1:])
        estimates.append(fit(problem, starts=1))
    expected, found = estimates
    assert found.x == pytest.approx(expected.x, abs=0.3 * expected.std[0])
    assert any("isolated outlier" in str(remark) for remark in found.problem.campaign.remarks)


def test_the_command_says_what_is_left_out_and_why(with_dropout, tmp_path, capsys):
    out = tmp_path / "comparison"
    assert main(["compare", str(with_dropout), "--out", str(out)]) == 0
    printed, page = capsys.readouterr().out, (out / "report.html").read_text(encoding="utf-8")
    for text in (printed, page):
        for part in ("run3.csv", "outlet_pressure", "0.14 s", "isolated outlier", "left out"):
            assert part in text


def test_clean_data_are_used_as_they_are(valid):
    raw = read_campaign(VALID_CAMPAIGN)
    assert not valid.remarks and not data_sentences(valid)
    for checked, run in zip(valid.runs, raw.runs, strict=True):
        for name, values in run.signals.items():
            np.testing.assert_array_equal(checked.signals[name], values)
    for name, channel in raw.channels.items():
        assert valid.channels[name].noise == channel.noise
        assert valid.channels[name].measured_noise == pytest.approx(channel.noise, rel=0.1)
    assert checked_campaign(valid) is valid


@pytest.mark.parametrize("factor", [0.5, 2.0, 1e3])
def test_misstated_noise_is_the_first_sentence_and_the_measured_one_is_used(factor, valid, tmp_path, capsys):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "unit: MPa, noise: 0.0015", f"unit: MPa, noise: {0.0015 * factor:g}")
    campaign = checked_campaign(read_campaign(folder))
    assert campaign.channels["outlet_pressure"].noise == pytest.approx(1500.0, rel=0.1)
    assert campaign.channels["current"].noise == valid.channels["current"].noise
    first = data_sentences(campaign)[0]
    assert f"outlet_pressure {0.0015 * factor:.3g} MPa stated, 0.0015" in first and "is used" in first
    assert main(["campaign", "check", str(folder)]) == 1
    title, *rest = capsys.readouterr().out.splitlines()
    assert title.startswith("bench: ") and rest[0].startswith("Stated and measured noise differ: outlet_pressure")


def test_correlated_noise_is_measured_in_full(valid):
    rng, runs = np.random.default_rng(1), []
    for run in valid.runs:
        white = 0.02 * rng.standard_normal(len(run.time) + 1)
        coloured = (white[1:] + 0.5 * white[:-1]) / np.hypot(1.0, 0.5)
        model = 5.0 * np.sin(2.0 * np.pi * run.conditions["frequency"] * run.time)
        runs.append(dataclasses.replace(run, signals={"current": model + coloured}))
    campaign = dataclasses.replace(read_campaign(VALID_CAMPAIGN), runs=tuple(runs))

    found = measure_noise(campaign, "current")
    assert (found.low, found.high) == pytest.approx((0.02, 0.02), rel=0.1)


def test_cycles_shorter_than_a_sample_interval_are_no_repetition(valid):
    runs = tuple(dataclasses.replace(run, time=1e5 * run.time) for run in valid.runs)
    campaign = dataclasses.replace(valid, runs=runs)
    found = measure_noise(campaign, "current")
    assert found.low < 0.02 < found.high  # bounds from the fast part only


def test_rounding_of_the_recorder_counts_as_noise_and_is_no_stuck_sensor(tmp_path):
    folder, step = copy_campaign(tmp_path / "bench"), 6e-3
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        modify_table(folder, run, lambda f: f.assign(**{PRESSURE: step * np.round(f[PRESSURE] / step)}))
    campaign = checked_campaign(read_campaign(folder))
    expected = np.hypot(1.5e-3, step / np.sqrt(12.0)) * 1e6
    assert campaign.channels["outlet_pressure"].noise == pytest.approx(expected, rel=0.2)
    assert not [r for r in campaign.remarks if "stuck" in r.sentence or "left out" in r.sentence]


def test_fit_writes_the_noise_and_the_remarks(with_dropout, tmp_path, capsys):
    replace_in_yaml(with_dropout, "unit: A, noise: 0.02", "unit: A, noise: 0.01")
    text = (with_dropout / "campaign.yaml").read_text().replace("  coil_resistance: 0.02\n", "")
    (with_dropout / "campaign.yaml").write_text(text)
    assert main(["fit", str(with_dropout), "--starts", "1", "--out", str(tmp_path / "fit")]) == 0
    data = json.loads((tmp_path / "fit" / "fit.json").read_text())
    noise = data["data"]["noise"]["current"]
    assert noise["stated"] == pytest.approx(0.01) and noise["used"] == pytest.approx(0.02, rel=0.1)
    assert any("isolated outlier" in remark for remark in data["data"]["remarks"])
    assert data["findings"][0].startswith("Stated and measured noise differ: current 0.01 A stated")
    assert "Stated and measured noise differ" in capsys.readouterr().out
