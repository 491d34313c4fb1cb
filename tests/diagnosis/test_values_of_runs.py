"""Unknowns of single runs: three records of a valve with a lag, each of which starts at a pressure of its own."""

import json

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.diagnosis.search.checkpoint import fit_as_plain, fit_of_plain
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.inference.fit.calibrated_model import calibrate
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.measurements.campaign import BenchRun, CampaignError
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns

RIG = '''"""A valve whose pressure follows its command with a lag."""
from edhas_jax import Rig, drive, par, signal, slot, state


class Lag(Rig):
    """p' = (gain u - p) / tau."""

    time_step, duration = 1e-3, 4.0
    command = drive("V", "command of the valve", 1.0)
    gain: float = par(2.2e6, "Pa/V", (1e4, 1e8), "pressure per voltage")
    tau: float = par(0.08, "s", (1e-3, 10.0), "time constant")
    first: float = par(1e5, "Pa", (0.0, 1e8), "pressure at the start")
    pressure = state("Pa", "pressure at the outlet", "first")
    leak = slot("valve", "Pa/s", "loss of pressure", "pressure", 1e6)

    def equations(self, y, s):
        return {"pressure": (self.gain * s.command - y.pressure) / self.tau - self.leak.apply(0.0, s)}
'''
GAIN, TAU, NOISE = 20.0, 0.1, 0.05  # bar/V, s, bar
STARTS, STATED = (1.0, 30.0, 12.0), (1.3, 24.0, 14.0)  # bar
OWN = "{gain: 0.2, tau: 0.5, first: {relative: 0.5, per: run}}"


def record(start: float, seed: int) -> str:
    """The record of one run as CSV, from the exact solution between two samples of a command that is linear there."""
    dt, n = 0.01, 150
    t = dt * np.arange(n)
    u, p, keep = 1.0 + 0.3 * np.sin(2.0 * np.pi * 1.5 * t), np.full(n, start), np.exp(-dt / TAU)
    for k in range(n - 1):
        slope = (u[k + 1] - u[k]) / dt
        steady = GAIN * (u[k] - TAU * slope)
        p[k + 1] = steady + GAIN * slope * dt + keep * (p[k] - steady)
    p += NOISE * np.random.default_rng(seed).standard_normal(n)
    return "time [s],u [V],p [bar]\n" + "".join(f"{a:.3f},{b:.6f},{c:.4f}\n" for a, b, c in zip(t, u, p, strict=True))


@pytest.fixture
def campaign_of(tmp_path):
    """A campaign folder from its `uncertain` and, by run, further keys."""

    def write(uncertain=OWN, uses=("fit", "fit", "fit"), more=("", "", "")):
        folder = tmp_path / "starts"
        folder.mkdir(exist_ok=True)
        (folder / "lag.py").write_text(RIG)
        lines = ["name: starts", "rig: lag.py:Lag", "drives: {command: u}", f"uncertain: {uncertain}",
                 f"signals: {{pressure: {{column: p, unit: bar, noise: {NOISE}}}}}", "runs:"]  # fmt: skip
        for k, (start, stated, use) in enumerate(zip(STARTS, STATED, uses, strict=True), 1):
            (folder / f"run{k}.csv").write_text(record(start, k))
            lines.append(f"  - {{file: run{k}.csv, use: {use}, first: {stated} bar{more[k - 1]}}}")
        (folder / "campaign.yaml").write_text("\n".join(lines))
        return folder

    return write


def read(folder):
    return read_campaign(folder, [folder / "lag.py"])


def within_errors(values, errors, truth):
    return all(abs(values[name] - value) < 3.0 * errors[name] for name, value in truth.items())


def test_each_run_has_a_start_of_its_own(campaign_of):
    folder = campaign_of()
    found = edhas.fit(folder, trust=[folder / "lag.py"])
    truth = {"gain": GAIN * 1e5, "tau": TAU} | {f"first in run{k}": 1e5 * p for k, p in enumerate(STARTS, 1)}
    assert list(found.fit.values) == list(truth)
    assert within_errors(found.fit.values, found.fit.standard_errors, truth)
    assert found.rms_residuals()["calibrated"]["fit"]["overall"] == pytest.approx(1.0, abs=0.1)
    assert found.drifting() == []
    # the model has no value of a single run, and the runs have all of theirs
    assert edhas.get(found.machine, "first") == 1e5
    assert [run.conditions["first"] for run in found.fit.campaign.runs] == [
        found.fit.values[f"first in run{k}"] for k in (1, 2, 3)
    ]


def test_a_fit_with_a_common_start_names_the_runs_that_want_another_one_and_the_remedy(campaign_of):
    folder = campaign_of("{gain: 0.2, tau: 0.5, first: 0.5}")
    found = edhas.fit(folder, trust=[folder / "lag.py"])
    assert found.rms_residuals()["calibrated"]["fit"]["overall"] > 5.0
    assert found.drifting()[0] == "first" and "tau" not in found.drifting()
    (sentence,) = [s for s in found.findings() if s.startswith("first drifts")]
    values = found.values_of_runs()["first"]
    assert [values[f"run{k}"] for k in (1, 2, 3)] == pytest.approx([1e5 * p for p in STARTS], rel=0.06)
    assert "2.999 MPa in run2" in sentence and "`first: {relative: 0.5, per: run}` under `uncertain`" in sentence


def test_a_held_out_run_tells_its_own_start_and_the_files_hold_it(campaign_of, tmp_path, capsys):
    folder, out = campaign_of(uses=("fit", "fit", "holdout")), tmp_path / "out"
    assert main(["fit", str(folder), "--rig", f"{folder}/lag.py:Lag", "--out", str(out), "--quiet"]) == 0
    stored = json.loads((out / "fit.json").read_text())
    assert "first in run3" not in stored["calibrated"]
    held_out = stored["of_runs"]["run3"]["first"]
    assert abs(held_out["value"] - 1e5 * STARTS[2]) < 3.0 * held_out["std"]
    assert any("is estimated from their own samples" in sentence for sentence in stored["findings"])
    assert "first in" not in (out / "config.yaml").read_text()
    # comparing the fitted model with the campaign takes the starts from the same folder
    compared = edhas.compare(folder, out / "config.yaml", trust=[folder / "lag.py"]).rms_over_noise()
    for run, row in compared.items():
        assert row["pressure"] == pytest.approx(stored["error"]["calibrated"]["fit"]["overall"], rel=0.2), run
    assert edhas.compare(folder, found_machine(out, folder)).rms_over_noise()["run2"]["pressure"] > 10.0


def found_machine(out, folder):
    from edhas_jax.config.machine_config import read_config

    return read_config(out / "config.yaml", trust=[folder / "lag.py"]).machine


def test_a_diagnosis_finds_nothing_missing_and_its_stages_are_kept(campaign_of):
    campaign = checked_campaign(read(campaign_of()))
    evaluated, _ = calibrate(campaign)
    assert within_errors(evaluated.fit.values, evaluated.fit.standard_errors, {"tau": TAU, "first in run2": 3e6})
    assert evaluated.residual_over_noise == pytest.approx(1.0, abs=0.1)
    arrays = {}
    plain = fit_as_plain(evaluated, arrays)
    again = fit_of_plain(campaign, json.loads(json.dumps(plain)), arrays)
    assert again.fit.values == evaluated.fit.values and again.fit.campaign.runs[0].conditions["first"] < 1.1e5


def test_a_model_that_is_written_alone_has_the_values_of_the_runs_beside_it(campaign_of, tmp_path):
    folder = campaign_of(uses=("fit", "fit", "holdout"))
    found = edhas.add(folder, [], trust=[folder / "lag.py"])
    found.save_model(tmp_path / "model.yaml")
    compared = edhas.compare(folder, tmp_path / "model.yaml", trust=[folder / "lag.py"])
    assert [row["pressure"] for row in compared.rms_over_noise().values()] == pytest.approx([1.0] * 3, abs=0.15)
    (note,) = [r for r in compared.campaign.remarks if "estimated with the model (model.runs.json)" in r.sentence]
    assert note.sentence.startswith("first: ")


def test_the_parts_of_a_divided_run_share_its_start(campaign_of):
    campaign, _ = split_for_holdout(checked_campaign(read(campaign_of())))
    names = [u.name for u in uncertain_unknowns(campaign) if u.run]
    assert names == ["first in run1", "first in run2", "first in run3"]
    found = fit(FitProblem(campaign, campaign.machine, uncertain_unknowns(campaign)), starts=1)
    assert found.of_other_runs is None
    starts = {run.whole: run.conditions["first"] for run in found.campaign.runs}
    assert starts == {f"run{k}": found.values[f"first in run{k}"] for k in (1, 2, 3)}


def test_one_run_alone_may_have_an_unknown_that_the_others_share(campaign_of):
    """The common factor does not act in the run that has its own value; derivatives are those of differences."""
    own = ", uncertain: {first: 0.4}"
    campaign = read(campaign_of("{tau: 0.5, first: 0.5}", more=("", own, "")))
    unknowns = uncertain_unknowns(campaign)
    assert [u.name for u in unknowns] == ["tau", "first", "first in run2"]
    model = MeasurementModel(campaign, campaign.machine, unknowns, campaign.runs)
    x, h = np.array([0.3, 0.2, -0.5]), 1e-5
    found = model.predict_all_runs(x, 4, with_sensitivities=True)
    acting = [[True, True, False], [True, False, True], [True, True, False]]
    for r in range(3):
        assert model.acting(r).tolist() == acting[r]
        for j in range(3):
            step = h * np.eye(3)[j]
            up, down = (model.predict_all_runs(x + s * step, 4)[r].values["pressure"] for s in (1.0, -1.0))
            slope = found[r].sensitivities["pressure"][:, j]
            assert (slope == 0.0).all() if not acting[r][j] else True
            assert slope == pytest.approx((up - down) / (2.0 * h), rel=1e-5, abs=1.0)
    run: BenchRun = campaign.runs[1]
    assert found[1].values["pressure"][0] == pytest.approx(run.conditions["first"] * np.exp(-0.4 * 0.5))
    assert found[0].values["pressure"][0] == pytest.approx(1.3e5 * np.exp(0.5 * 0.2))


def test_per_something_else_is_refused(campaign_of):
    with pytest.raises(CampaignError, match="uncertain.first.per: only `per: run` is possible here; got day"):
        read(campaign_of("{first: {relative: 0.5, per: day}}"))
