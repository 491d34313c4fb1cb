"""How well parameters are known: relative and absolute standard deviations, parameters whose value is zero."""

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core.units import difference_to_si
from edhas_jax.machine.parameters import ParameterError
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError, Spread, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.unknown_parameters import ParameterScale, uncertain_unknowns, unknown_around
from studies.campaign_writer import write_campaign
from tests.support.synthetic_campaign import bench, empty_campaign, measured

RIG = '''"""An axis whose speed has one gain for small commands and one more beyond 60 %."""
import jax.numpy as jnp

from edhas_jax import Rig, drive, par, signal, state


class Axis(Rig):
    """The command sets the speed."""

    time_step, duration = 5e-3, 4.0
    command = drive("-", "command", 0.0)
    slow: float = par(0.1, "m/s", (0.0, 20.0), "speed per command")
    fast: float = par(0.0, "m/s", (0.0, 20.0), "more of it from 60 %")
    first: float = par(0.0, "m", (-10.0, 10.0), "position at the start")
    ratio: float = par(0.0, "-", (-1.0, 1.0), "share of the command that is lost")
    position = state("m", "position", "first")

    def equations(self, y, s):
        a = jnp.abs(s.command)
        speed = self.slow * a + self.fast * jnp.maximum(a - 0.6, 0.0)
        return {"position": (1.0 - self.ratio) * jnp.sign(s.command) * speed}
'''
SLOW, FIRST, NOISE = 0.12, 0.03, 1e-4


@pytest.fixture
def axis(tmp_path):
    """A folder with a record of the axis, and `uncertain` of its campaign."""

    def write(uncertain, conditions="", name="axis"):
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        (folder / "axis.py").write_text(RIG)
        t = 0.01 * np.arange(400)
        u, x = 0.5 * np.sin(np.pi * t), FIRST + SLOW * 0.5 * (1.0 - np.cos(np.pi * t)) / np.pi
        x = x + NOISE * np.random.default_rng(1).standard_normal(len(t))
        rows = "".join(f"{a:.3f},{b:.6f},{1e3 * c:.4f}\n" for a, b, c in zip(t, u, x, strict=True))
        (folder / "move.csv").write_text("time [s],u [-],x [mm]\n" + rows)
        (folder / "campaign.yaml").write_text(
            f"name: axis\nrig: axis.py:Axis\ndrives: {{command: u}}\nuncertain: {uncertain}\n"
            "signals: {position: {column: x, unit: mm, noise: 0.1}}\n"
            f"runs: [{{file: move.csv, use: fit{conditions}}}]\n"
        )
        return folder

    return write


def read(folder):
    return read_campaign(folder, [folder / "axis.py"])


def test_a_parameter_whose_value_is_zero_is_estimated_from_an_absolute_standard_deviation(axis):
    folder = axis("{slow: 0.4, first: 50 mm, fast: 0.2 m/s}")
    found = edhas.fit(folder, trust=[folder / "axis.py"])
    values, errors = found.fit.values, found.fit.standard_errors
    assert abs(values["slow"] - SLOW) < 3.0 * errors["slow"] and abs(values["first"] - FIRST) < 3.0 * errors["first"]
    assert found.rms_residuals()["calibrated"]["fit"]["overall"] == pytest.approx(1.0, abs=0.1)
    # what the record never reaches keeps its prior, whose mean lies at the limit of the parameter
    assert found.unidentified() == ["fast"] and values["fast"] == 0.0 and "fast" in found.fit.at_limit


@pytest.mark.parametrize(
    ("uncertain", "sentence"),
    [
        ("{fast: 0.5}", "fast: the value is 0, of which no share can be taken; .* such as 0.2 m/s"),
        ("{ratio: 0.5}", "ratio: the value is 0, of which no share can be taken; .* such as {absolute: 0.01}"),
        ("{first: {relative: 0.5, per: run}}", "first: in run 1 the value is 0, of which no share can be taken"),
        ("{slow: 0.5 V}", 'slow: .* "0.5 V" is a voltage'),
        ("{slow: {absolute: 0.5}}", "slow: .* a unit is missing"),
        ("{slow: {relative: 0.5 m/s}}", "slow: .* is a speed, not a plain number"),
        ("{slow: {relative: 0.5, absolute: 1 m/s}}", "slow: one of `relative: 0.1` and `absolute: 1 mm/s`"),
        ("{slow: {}}", "slow: one of `relative: 0.1` and `absolute: 1 mm/s` belongs here"),
        ("{slow: -0.1 m/s}", "slow: must be above 0"),
        ("{slow: [0.1]}", "slow: a standard deviation belongs here"),
    ],
)
def test_what_cannot_be_a_standard_deviation_is_refused_in_one_sentence(axis, uncertain, sentence):
    with pytest.raises(CampaignError, match=f"campaign.yaml:4: uncertain.{sentence}") as refused:
        read(axis(uncertain))
    assert len(str(refused.value).splitlines()) == 1


def test_every_form_is_read(axis):
    campaign = read(axis("{slow: 20 %, fast: {absolute: 200 mm/s}, first: 1 cm, ratio: {absolute: 0.1}}"))
    assert campaign.uncertain == {
        "slow": Spread(0.2), "fast": Spread(0.2, True), "first": Spread(0.01, True), "ratio": Spread(0.1, True)
    }  # fmt: skip
    (relative, *absolute) = uncertain_unknowns(campaign)
    assert relative.scale is ParameterScale.LOGARITHMIC
    assert [(u.scale, u.centre, u.spread) for u in absolute] == [
        (ParameterScale.LINEAR, 0.0, 0.2), (ParameterScale.LINEAR, 0.0, 0.01), (ParameterScale.LINEAR, 0.0, 0.1)
    ]  # fmt: skip


def test_an_absolute_error_that_is_common_to_all_runs_is_a_difference(axis):
    campaign = read(axis("{first: 10 mm}", ", first: 2 m"))
    (run,) = campaign.runs
    moved = edhas.change(campaign.machine, first=0.005)
    assert edhas.get(campaign.machine_of(run, moved), "first") == pytest.approx(2.005, rel=1e-12)


def test_a_diagnosis_takes_a_zero_too(axis):
    folder = axis("{slow: 0.4, first: 50 mm, fast: 0.2 m/s}")
    found = edhas.diagnose(folder, trust=[folder / "axis.py"])
    assert found.verdict.value == "adequate"
    assert found.final.values["first"] == pytest.approx(FIRST, abs=1e-4)


def test_a_share_of_zero_is_refused_from_python_too():
    with pytest.raises(ParameterError, match="emf_feedforward: the value is 0"):
        unknown_around(edhas.change(bench(), emf_feedforward=0.0), "emf_feedforward", Spread(0.1))


def test_a_campaign_is_written_and_read_with_its_standard_deviations(tmp_path):
    uncertain = {"coil_resistance": 0.02, "mover_mass": Spread(0.012, True)}
    uncertain["coulomb_friction"] = Spread(0.5, True)
    campaign = measured(empty_campaign(uncertain=uncertain), bench())
    (first, *others) = campaign.runs
    own = {"mover_damping": Spread(0.3), "pump_stroke": Spread(5e-5, True)}
    runs = (BenchRun(**{**vars(first), "uncertain": own}), *others)
    write_campaign(Campaign(**{**vars(campaign), "runs": runs}), tmp_path / "out")
    back = read_campaign(tmp_path / "out")
    assert back.uncertain == campaign.uncertain
    assert [run.uncertain for run in back.runs] == [own, {}, {}] and back.runs[0].use is Use.FIT


def test_a_standard_deviation_is_a_difference():
    """A hundredth of a degree Celsius is a hundredth of a kelvin, not 273 K."""
    assert difference_to_si("0.01 degC", "K") == pytest.approx(0.01, abs=1e-12)
    assert difference_to_si("2 mm", "m") == 2e-3 and difference_to_si("0.5", "-") == 0.5
    assert difference_to_si("10 %", "-") == 0.1
