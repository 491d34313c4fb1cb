"""Choices for a fit: each does what the same change of the campaign does; wrong ones are refused with a sentence."""

import dataclasses
import json
import math

import numpy as np
import pytest
import yaml

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.inference.fit.fit_choices_reader import read_choices
from edhas_jax.machine.parameters import get_parameter
from edhas_jax.measurements.campaign import CampaignError, Spread, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from studies.campaign_writer import write_campaign
from tests.diagnosis.test_values_of_runs import OWN, campaign_of  # noqa: F401
from tests.support.synthetic_campaign import bench, empty_campaign, measured

TRUTH = {"coil_resistance": 1.45, "force_constant": 24.2, "mover_damping": 25.0, "coulomb_friction": 3.2}


@pytest.fixture(scope="module")
def campaign():
    raw = measured(empty_campaign(lengths=(201, 201, 201)), edhas.change(bench(), **TRUTH))
    return checked_campaign(raw)


def chosen(campaign, **choices):
    return edhas.fit(campaign, starts=1, choices=choices).fit


@pytest.fixture(scope="module")
def usual(campaign):
    return chosen(campaign)


def assert_same(one, other):
    assert list(one.values) == list(other.values)
    np.testing.assert_array_equal(one.x, other.x)
    np.testing.assert_array_equal(one.covariance, other.covariance)


def test_no_choices_change_nothing(campaign, usual):
    assert_same(usual, edhas.fit(campaign, starts=1).fit)


def test_a_fixed_parameter_is_held_at_its_value(campaign):
    found = chosen(campaign, parameters={"force_constant": {"free": False, "value": "24.2 N/A"}})
    assert "force_constant" not in found.values and get_parameter(found.machine, "force_constant") == 24.2
    known = {name: spread for name, spread in campaign.uncertain.items() if name != "force_constant"}
    machine = edhas.change(campaign.machine, force_constant=24.2)
    assert_same(found, chosen(dataclasses.replace(campaign, machine=machine, uncertain=known)))


def test_another_parameter_is_freed_with_a_prior(campaign):
    found = chosen(campaign, parameters={"coil_inductance": {"prior": 0.2}})
    more = dataclasses.replace(campaign, uncertain=campaign.uncertain | {"coil_inductance": Spread(0.2)})
    assert_same(found, chosen(more))


def test_a_prior_pulls_and_without_one_nothing_does(campaign, usual):
    known = get_parameter(campaign.machine, "mover_damping")
    narrow = chosen(campaign, parameters={"mover_damping": {"prior": "0.1 %"}})
    assert abs(narrow.values["mover_damping"] / known - 1.0) < 0.01 < abs(usual.values["mover_damping"] / known - 1.0)
    free = chosen(campaign, parameters={"mover_damping": {"prior": "none"}})
    assert free.standard_errors["mover_damping"] > usual.standard_errors["mover_damping"]


def test_limits_hold_the_search(campaign, usual):
    value = usual.values["coulomb_friction"]
    found = chosen(campaign, parameters={"coulomb_friction": {"max": 0.9 * value}})
    assert found.at_limit == {"coulomb_friction": "upper"}
    assert found.values["coulomb_friction"] == pytest.approx(0.9 * value, rel=1e-6)


def test_the_first_start_has_the_initial_values(campaign):
    choices = read_choices({"parameters": {"coil_resistance": {"value": "1.45 Ω"}}}, campaign)
    unknowns = choices.unknowns(choices.applied(campaign))
    points = choices.starts(unknowns, 3)
    assert points.shape == (3, 4) and unknowns[0].value(points[0, 0]) == pytest.approx(1.45, rel=1e-12)
    assert not points[0, 1:].any() and points[1:].all()


def test_chosen_runs_are_fitted_and_the_others_held_out(campaign):
    found = chosen(campaign, runs=["run3"])
    uses = {run.name: run.use for run in found.problem.campaign.runs}
    assert uses == {"run1": Use.HOLDOUT, "run2": Use.HOLDOUT, "run3": Use.FIT}
    assert [run.name for run in found.runs] == ["run3"]


def test_a_factor_on_the_noise_widens_the_errors_and_results_stay_over_the_noise_of_the_sensors(campaign, usual):
    every = dict.fromkeys(campaign.channels, 3.0)
    result = edhas.fit(campaign, starts=1, choices={"signals": every})
    prior = np.eye(4)  # information of the priors, which no factor changes
    information = (np.linalg.inv(usual.covariance) - prior) / 9.0 + prior
    np.testing.assert_allclose(result.fit.std, np.sqrt(np.diag(np.linalg.inv(information))), rtol=0.02)
    assert result.rms_residuals()["calibrated"]["fit"]["overall"] == pytest.approx(1.0, abs=0.1)


def test_a_signal_that_is_not_chosen_has_no_influence(campaign):
    found = chosen(campaign, signals={"voltage": 1, "current": 1})
    spoilt = tuple(
        dataclasses.replace(run, signals=run.signals | {"piston_position": 2.0 * run.signals["piston_position"]})
        for run in campaign.runs
    )
    spoilt = dataclasses.replace(campaign, runs=spoilt)
    assert_same(found, chosen(spoilt, signals={"voltage": 1, "current": 1}))


def test_samples_outside_a_window_have_no_influence(campaign):
    window = {"run1": ["20 ms", 0.06]}
    found = chosen(campaign, windows=window)
    first, *others = campaign.runs
    used = (first.time >= 0.02) & (first.time <= 0.06)
    assert sum(np.isfinite(v).sum() for v in found.runs[0].signals.values()) == 3 * used.sum()
    spoilt = {name: np.where(used, values, 7.0 * values) for name, values in first.signals.items()}
    spoilt = dataclasses.replace(campaign, runs=(dataclasses.replace(first, signals=spoilt), *others))
    assert_same(found, chosen(spoilt, windows=window))


@pytest.mark.parametrize(
    ("choices", "sentence"),
    [
        ({"parameter": {}}, "parameter: unknown key; nearest: parameters"),
        ({"parameters": {"coil": {"free": False}}}, "parameters.coil:"),
        ({"parameters": {"coil_resistance": {"free": "perhaps"}}}, "free: true or false belongs here, not perhaps"),
        ({"parameters": {"coil_resistance": {"value": "3 mm"}}}, "coil_resistance.value:"),
        ({"parameters": {"coil_resistance": {"value": "5 Ω"}}}, "value: the search goes from 1.302 ohm to"),
        ({"parameters": {"coil_resistance": {"max": "5 Ω"}}}, "max: must lie from 1.302 ohm to"),
        ({"parameters": {"coil_resistance": {"min": "1.5 Ω", "max": "1.4 Ω"}}}, "min must be below max"),
        ({"parameters": {"coil_resistance": {"prior": "-1"}}}, "prior: must be above 0"),
        ({"parameters": {"coil_resistance": {"free": False, "max": "1.5 Ω"}}}, "max: means nothing for a parameter"),
        ({"parameters": {"coulomb_friction": {"free": False, "value": "7 N"}}}, "parameters: "),
        ({"parameters": {"coil_inductance": {"free": True}}}, "needs a prior, such as `prior: 0.1`"),
        ({"parameters": {name: {"free": False} for name in TRUTH}}, "no parameter is left free"),
        ({"parameters": {"coil_resistance in run1": {"free": False}}}, "no fitted run has a value of its own"),
        ({"runs": []}, "a list of runs to be fitted belongs here"),
        ({"runs": ["run4"]}, "no run run4; nearest: run3"),
        ({"signals": {"flow": 1}}, "signals.flow: no signal that can be used"),
        ({"signals": {}}, "no signal is left to be fitted"),
        ({"signals": {"current": 0}}, "signals.current: a factor on the noise from 0.001 to 1000 belongs here; got 0"),
        ({"windows": {"run1": ["0.05 s"]}}, "windows.run1: first and last time belong here"),
        ({"windows": {"run1": ["80 ms", "20 ms"]}}, "holds no samples; the record is from 0 s to 0.1 s"),
        ({"windows": {"run4": ["20 ms", "80 ms"]}}, "windows.run4: no run run4"),
    ],
)  # fmt: skip
def test_wrong_choices_are_refused_with_a_sentence(campaign, choices, sentence):
    with pytest.raises(CampaignError) as caught:
        read_choices(choices, campaign)
    assert sentence in str(caught.value), str(caught.value)


def test_a_file_says_its_lines(campaign, tmp_path):
    path = tmp_path / "choices.yaml"
    path.write_text("runs: [run1]\nsignals:\n  flow: 1\n")
    with pytest.raises(CampaignError, match=r"choices\.yaml:3: signals\.flow: no signal"):
        read_choices(path, campaign)


def test_command_and_call_do_the_same_and_the_result_has_the_choices(tmp_path):
    raw = measured(empty_campaign(lengths=(201, 201, 201)), edhas.change(bench(), **TRUTH))
    folder, file, out = tmp_path / "bench", tmp_path / "choices.yaml", tmp_path / "fitted"
    write_campaign(raw, folder)
    choices = {
        "parameters": {
            "coil_resistance": {"value": "1.45 Ω", "prior": {"absolute": "20 mΩ"}, "max": "1.48 Ω"},
            "coulomb_friction": {"free": False, "value": "3.2 N"}, "mover_damping": {"prior": "none"},
        },
        "runs": ["run1", "run3"], "signals": {"voltage": 1, "current": 2.5},
        "windows": {"run3": ["10 ms", "90 ms"]},
    }  # fmt: skip
    file.write_text(yaml.safe_dump(choices, allow_unicode=True), encoding="utf-8")
    assert main(["fit", str(folder), "--starts", "1", "--choices", str(file), "--out", str(out), "--quiet"]) == 0
    called = edhas.fit(folder, starts=1, choices=choices)
    written = json.loads((out / "fit.json").read_text())
    assert {n: row["value"] for n, row in written["calibrated"].items()} == called.fit.values
    assert read_choices(written["choices"], called.given) == called.choices == read_choices(choices, called.given)
    said = " ".join(called.findings())
    for part in ("coulomb_friction at 3.2 N", "run1, run3 alone", "Not used by choice: piston_position", "current 2.5",
                 "Of run3 only 0.01 to 0.09 s"):  # fmt: skip
        assert part in said


def test_a_value_of_a_single_run_can_be_held(campaign_of):  # noqa: F811
    folder = campaign_of(OWN)
    choices = {"parameters": {"first in run1": {"free": False, "value": "1 bar"}}}
    found = edhas.fit(folder, starts=1, choices=choices, trust=[folder / "lag.py"]).fit
    assert "first in run1" not in found.values and "first in run2" in found.values
    (run,) = (run for run in found.campaign.runs if run.name == "run1")
    assert math.isclose(run.conditions["first"], 1e5)
