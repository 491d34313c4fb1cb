"""Guesses of what the columns of a logger's file are, and the campaign file made from them."""

import numpy as np
import pytest

from edhas_jax.config.tables.table_reader import read_table
from edhas_jax.measurements.campaign_draft import CampaignDraft, DraftRun
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.table_guess import GuessedColumn, Role, clock_unit, guess_columns

AVAILABLE = "voltage", "current", "piston_position", "piston_velocity", "outlet_pressure", "outlet_flow"


def guessed(tmp_path, text):
    """The guesses for a text file, by column, and the table."""
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    table = read_table(path, lambda remark: None)
    return {guess.column: guess for guess in guess_columns(table, AVAILABLE)}


def rows(count, *columns):
    """Lines of numbers; each column is a function of the index."""
    return "".join(",".join(f"{f(k):.6g}" for f in columns) + "\n" for k in range(count))


def test_names_of_loggers_are_understood(tmp_path):
    text = "t,u_cmd,i_coil,x [µm],p_out,q\n" + rows(20, lambda k: 0.2 * k, *[lambda k: k % 7] * 5)
    found = guessed(tmp_path, text)
    assert {name: guess.signal for name, guess in found.items()} == {
        "t": "", "u_cmd": "voltage", "i_coil": "current", "x": "piston_position", "p_out": "outlet_pressure",
        "q": "outlet_flow",
    }  # fmt: skip
    assert found["t"].role is Role.TIME and found["t"].unit == "ms" and not found["t"].unit_stated
    assert found["x"].unit == "µm" and found["x"].unit_stated


def test_german_names_semicolons_and_decimal_commas(tmp_path):
    text = "Zeit [s];Spannung Ist [V];Strom Ist [A];Weg [mm];Temperatur [K]\n"
    text += "".join(f"{0.001 * k:.3f};{k % 5},5;0,25;1,{k % 9};293,1\n".replace(".", ",") for k in range(20))
    found = guessed(tmp_path, text)
    assert [g.signal for g in found.values()] == ["", "voltage", "current", "piston_position", ""]
    assert found["Temperatur"].role is Role.UNUSED


def test_a_unit_decides_where_the_name_says_nothing(tmp_path):
    text = "time [s],channel 1 [A],channel 2 [bar],channel 3 [V]\n"
    text += rows(20, lambda k: 0.001 * k, *[lambda k: k % 3] * 3)
    assert [g.signal for g in guessed(tmp_path, text).values()] == ["", "current", "outlet_pressure", "voltage"]


def test_a_name_with_the_unit_of_another_quantity_is_no_guess(tmp_path):
    text = "time [s],current [V],flow [bar]\n" + rows(20, lambda k: 0.001 * k, *[lambda k: k % 3] * 2)
    found = guessed(tmp_path, text)
    assert found["current"].signal != "current" and found["flow"].signal != "outlet_flow"


def test_a_time_without_a_name_is_the_column_that_increases(tmp_path):
    text = "a,b,current\n" + rows(50, lambda k: np.sin(k), lambda k: 5000.0 + 0.01 * k, lambda k: k % 3)
    found = guessed(tmp_path, text)
    assert found["b"].role is Role.TIME and found["b"].unit == "s"


@pytest.mark.parametrize(("step", "unit"), [(5e-4, "s"), (0.5, "ms"), (200.0, "µs"), (0.04, "s")])
def test_the_unit_of_a_clock_follows_from_its_steps(step, unit):
    assert clock_unit(step * np.arange(100)) == unit


def test_the_draft_is_a_campaign_that_can_be_read(tmp_path):
    text = "t;i_coil;soll [mm];x [mm]\n"
    text += rows(30, lambda k: 0.5 * k, *[lambda k: np.sin(0.1 * k)] * 3).replace(",", ";")
    path = tmp_path / "log 1.csv"
    path.write_text(text)
    columns = guess_columns(read_table(path, lambda remark: None), AVAILABLE)
    entries = {"window": "{from: 0 s, to: 10 ms}"}
    draft = CampaignDraft("bench: 1", "actuator_bench", columns, [DraftRun("log 1.csv", "fit", entries)])
    assert not draft.problems()
    (tmp_path / "campaign.yaml").write_text(draft.text(), encoding="utf-8")
    campaign = read_campaign(tmp_path)
    assert campaign.name == "bench: 1" and set(campaign.channels) == {"current", "piston_position"}
    assert campaign.runs[0].reference is not None and campaign.runs[0].time[-1] == pytest.approx(0.01)


def test_all_problems_of_a_draft_are_said_at_once(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("a,b\n" + rows(20, lambda k: k % 3, lambda k: k % 5))
    columns = guess_columns(read_table(path, lambda remark: None), AVAILABLE)
    problems = "\n".join(CampaignDraft("x", "actuator_bench", columns, [DraftRun("run.csv", "holdout")]).problems())
    for part in ("No column is the time", "No column is a signal", "All runs are held out"):
        assert part in problems


def test_a_run_whose_set_point_no_column_holds_has_to_say_how_it_was_driven(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,i,soll [mm]\n" + rows(20, lambda k: 0.5 * k, *[lambda k: k % 5] * 2))
    recorded = guess_columns(read_table(path, lambda remark: None), AVAILABLE)
    columns = [c._replace(role=Role.UNUSED) if c.role is Role.SET_POINT else c for c in recorded]
    runs = [DraftRun("run.csv", "fit", {"frequency": "9 Hz"})]
    (problem,) = CampaignDraft("x", "pump_bench", columns, runs).problems()
    assert problem == "run.csv was driven by a set point that no column holds: write its amplitude."
    (problem,) = CampaignDraft("x", "actuator_system", columns, [DraftRun("run.csv")]).problems()
    assert problem.endswith("write its target.")
    draft = CampaignDraft("x", "pump_bench", recorded, runs)
    assert not draft.problems() and "frequency" not in draft.text(), "the recorded set point drives the run"
    (tmp_path / "campaign.yaml").write_text(draft.text())
    read_campaign(tmp_path)


@pytest.mark.parametrize(
    ("rig", "more"),
    [
        ("actuator_bench", set()), ("pump_bench", {"piston_clearance", "load_orifice_area"}),
        ("actuator_system", {"piston_clearance", "cylinder_sliding_friction", "cylinder_breakaway_friction"}),
    ],
)  # fmt: skip
def test_dry_friction_is_uncertain_unless_the_engineer_says_otherwise(rig, more, tmp_path):
    columns = [GuessedColumn("t", Role.TIME, "", "ms", False), GuessedColumn("i", Role.SIGNAL, "current", "A", False)]
    entries = {"frequency": "10 Hz", "amplitude": "3 mm"} if rig != "actuator_system" else {"target": "10 mm"}
    (tmp_path / "run.csv").write_text("t,i\n" + rows(30, lambda k: 0.5 * k, lambda k: k % 5))
    draft = CampaignDraft("x", rig, columns, [DraftRun("run.csv", "fit", entries)])
    (tmp_path / "campaign.yaml").write_text(draft.text())
    usual = {"coil_resistance", "force_constant", "mover_damping", "coulomb_friction", "static_friction"}
    campaign = read_campaign(tmp_path)
    assert set(campaign.uncertain) == usual | more
    assert not any("lacks" in remark.sentence for remark in campaign.remarks)


def test_names_with_markup_of_yaml_stay_names(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text('t,"i: {x} #1"\n' + rows(20, lambda k: 0.5 * k, lambda k: k % 5))
    columns = [g._replace(role=Role.SIGNAL, signal="current", unit="A") if g.column != "t" else g
               for g in guess_columns(read_table(path, lambda remark: None), AVAILABLE)]  # fmt: skip
    draft = CampaignDraft("n: [", "actuator_bench", columns, [DraftRun("run.csv")])
    (tmp_path / "campaign.yaml").write_text(draft.text())
    campaign = read_campaign(tmp_path)
    assert campaign.name == "n: [" and "current" in campaign.runs[0].signals
