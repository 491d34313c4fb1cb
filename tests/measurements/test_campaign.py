"""Reading campaigns: a valid one in three file formats, and the messages for an invalid one."""

import jax
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

import edhas_jax as edhas
from edhas_jax.core.remark import Severity
from edhas_jax.machine.components.controllers import CascadeController
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.measurements.campaign import CampaignError, Spread, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, modify_table, replace_in_yaml

PRESSURE = "outlet_pressure [MPa]"


@pytest.fixture()
def folder(tmp_path):
    return copy_campaign(tmp_path / "bench")


def only_error_or_warning(remarks):
    (remark,) = [r for r in remarks if r.severity is not Severity.NOTE]
    return remark


def test_a_valid_campaign():
    campaign = read_campaign(VALID_CAMPAIGN)
    assert campaign.name == "bench" and not campaign.remarks
    assert [r.name for r in campaign.runs] == ["run3", "run4", "run8"]
    assert [r.name for r in campaign.runs_for(Use.HOLDOUT)] == ["run8"]
    assert [e.id for e in campaign.machine.effects] == ["lugre_friction", "piston_leakage", "entrained_air"]
    assert campaign.channels["outlet_pressure"].noise == pytest.approx(1500.0)
    assert campaign.channels["outlet_flow"].noise == pytest.approx(0.012 / 6e4)
    assert campaign.uncertain["coil_resistance"] == Spread(0.02)
    run = campaign.runs[0]
    assert run.conditions == {"frequency": 20.0, "amplitude": 3.5e-3, "load_orifice_area": pytest.approx(4.2e-6)}
    frame = pd.read_csv(VALID_CAMPAIGN / "run3.csv")
    assert np.allclose(run.time, frame["time [ms]"] * 1e-3, rtol=1e-14)
    assert np.allclose(run.signals["outlet_pressure"], frame[PRESSURE] * 1e6, rtol=1e-14)
    assert run.interval == pytest.approx(0.2e-3) and list(run.lines[:2]) == [2, 3]
    assert read_campaign(VALID_CAMPAIGN / "campaign.yaml").name == "bench"


def test_an_uncertain_condition_is_scaled_by_a_factor_common_to_all_runs():
    campaign = read_campaign(VALID_CAMPAIGN)
    run = campaign.runs[2]
    nominal = campaign.machine_of(run)
    assert edhas.get(nominal, "frequency") == 25.0 and edhas.get(nominal, "load_orifice_area") == pytest.approx(1.5e-6)
    larger = set_parameters(campaign.machine, {"load_orifice_area": 4.2e-6 * 1.1, "frequency": 99.0})
    scaled = campaign.machine_of(run, larger)
    # the orifice area is uncertain, so that the machine's value is a factor; the frequency is not
    assert edhas.get(scaled, "load_orifice_area") == pytest.approx(1.5e-6 * 1.1)
    assert edhas.get(scaled, "frequency") == 25.0

    def area(factor):
        machine = set_parameters(campaign.machine, {"load_orifice_area": 4.2e-6 * factor})
        return edhas.get(campaign.machine_of(run, machine), "load_orifice_area")

    assert jax.grad(area)(1.0) == pytest.approx(1.5e-6)


def test_parquet_and_matlab_files_give_the_same_campaign(folder):
    frame = pd.read_csv(folder / "run3.csv")
    pq.write_table(pa.Table.from_pandas(frame), folder / "run3.parquet")
    replace_in_yaml(folder, "run3.csv", "run3.parquet")
    frame = pd.read_csv(folder / "run4.csv")
    vectors = {cell.partition(" ")[0]: frame[cell].to_numpy() for cell in frame}
    savemat(folder / "run4.mat", vectors | {"units": {"time": "ms"}, "comment": "bench 2"})
    replace_in_yaml(folder, "run4.csv", "run4.mat")
    expected, same = read_campaign(VALID_CAMPAIGN), read_campaign(folder)
    assert not same.remarks
    for one, other in zip(expected.runs, same.runs, strict=True):
        assert np.array_equal(one.time, other.time) and one.signals.keys() == other.signals.keys()
        assert all(np.array_equal(one.signals[n], other.signals[n]) for n in one.signals)


def test_columns_with_other_names_and_units(folder):
    names = {"time [ms]": "t", PRESSURE: "p_out", "current [A]": "i [mA]"}
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        modify_table(folder, run, lambda f: f.assign(**{"current [A]": 1e3 * f["current [A]"]}).rename(columns=names))
    replace_in_yaml(folder, "signals:   #", "time: {column: t, unit: ms}\nsignals:   #")
    replace_in_yaml(folder, "{unit: MPa, noise: 0.0015}", "{unit: MPa, noise: 0.0015, column: p_out}")
    replace_in_yaml(folder, "  current: {unit: A, noise: 0.02}", "  current: {unit: mA, noise: 20, column: i}")
    expected, same = read_campaign(VALID_CAMPAIGN), read_campaign(folder)
    assert not same.remarks
    assert same.channels["current"].noise == pytest.approx(0.02)
    for name, values in expected.runs[1].signals.items():
        assert np.allclose(values, same.runs[1].signals[name], rtol=1e-5)


SET_POINTS = [("wanted [mm]", "wanted"), ("wanted", "{column: wanted, unit: mm}"), ("wanted [mm]", "{column: wanted}")]


@pytest.mark.parametrize(("column", "reference"), SET_POINTS)
def test_a_recorded_set_point_drives_the_control_loop(tmp_path, column, reference):
    time = 1e-3 * np.arange(500)
    set_point = 5e-3 * np.sin(2 * np.pi * 3.0 * time)
    frame = pd.DataFrame({"time [s]": time, column: 1e3 * set_point, "voltage [V]": time})
    frame.assign(**{"piston_position [m]": set_point}).to_csv(tmp_path / "run1.csv", index=False)
    (tmp_path / "campaign.yaml").write_text(f"reference: {reference}" + """
rig: actuator_bench
amplifier: {kind: current, gain: 2 A/V}
controller: {kind: cascade, kp: 160 1/s, kv: 243 V*s/m}
without: [lugre_friction]
uncertain: {mover_mass: 0.1, coulomb_friction: 0.2}
signals:
  voltage: {unit: V, noise: 0.1}
  piston_position: {unit: m, noise: 1e-6}
runs:
  - {file: run1.csv, use: fit}
""")
    campaign = read_campaign(tmp_path)
    (run,) = campaign.runs
    machine = campaign.machine_of(run)
    assert isinstance(machine.controller, CascadeController) and machine.controller.cascade_velocity_gain == 243.0
    assert machine.amplifier.amplifier_gain == 2.0 and not machine.effects
    at, rate = machine.reference.value_and_rate(0.1)
    assert at == pytest.approx(5e-3 * np.sin(0.6 * np.pi), rel=1e-4) and rate < 0.0
    # an uncertain parameter of an effect that the model lacks is kept for when the effect is added
    assert campaign.uncertain_in(machine) == {"mover_mass": Spread(0.1)} and set(campaign.uncertain) == {
        "mover_mass", "coulomb_friction"
    }  # fmt: skip
    assert [r.severity for r in campaign.remarks] == [Severity.NOTE]


@pytest.mark.parametrize(
    ("old", "new", "line", "sentence"),
    [
        ("rig: pump_bench", "rig: pump_bensh", 3, "nearest: pump_bench"),
        ("  coil_resistance: 0.02", "  coil_resistence: 0.02", 5, "nearest: coil_resistance"),
        ("  coil_resistance: 0.02", "  coil_resistance: -1", 5, "must be above 0"),
        ("frequency: 20 Hz", "frequency: 20", 17, "a unit is missing"),
        ("frequency: 20 Hz", "frequenzy: 20 Hz", 17, "nearest: frequency"),
        ("use: holdout", "use: test", 19, "one of fit, holdout"),
        ("name: bench", "nome: bench", 2, "unknown key"),
        ("uncertain:   #", "drives: {command: u}\nuncertain:   #", 4, "set point of pump_bench is `reference:"),
        ("uncertain:   #", "without: [friction]\nuncertain:   #", 4, "no refined effect `friction`"),
        ("uncertain:   #", "parameters: {coil_resistance: 2 V}\nuncertain:   #", 4, "resistance"),
    ],
)
def test_errors_in_campaign_yaml(folder, old, new, line, sentence):
    replace_in_yaml(folder, old, new)
    with pytest.raises(CampaignError, match=sentence) as caught:
        read_campaign(folder)
    assert str(caught.value).startswith(f"{folder / 'campaign.yaml'}:{line}: ")


@pytest.mark.parametrize(
    ("old", "new", "line", "sentence"),
    [
        ("current: {unit: A, noise: 0.02}", "current: {unit: A, noise: 0}", 12, "must be above 0; got 0"),
        ("current: {unit: A, noise: 0.02}", "current: {unit: Amp, noise: 0.02}", 12, 'unknown unit "Amp"'),
        ("  current: {unit: A", "  rod_pressure: {unit: MPa", 12, "pump_bench has no such signal"),
        ("file: run8.csv", "file: run9.csv", 0, "no such file; the run is left out"),
    ],
)
def test_invalid_signals_and_runs_are_left_out(folder, old, new, line, sentence):
    replace_in_yaml(folder, old, new)
    remark = only_error_or_warning(read_campaign(folder).remarks)
    assert sentence in remark.sentence and remark.line == line and remark.severity is Severity.ERROR


def test_a_value_that_is_not_a_number_is_a_missing_sample(folder):
    def with_text(frame):
        return frame.astype({"current [A]": object}).replace({"current [A]": {frame["current [A]"][500]: "over"}})

    modify_table(folder, "run3.csv", with_text)
    campaign = read_campaign(folder)
    unreadable, missing = campaign.remarks
    assert unreadable.line == missing.line == 502
    assert '"over" is not a number' in unreadable.sentence and "1 missing sample" in missing.sentence
    missing_samples = np.isnan(campaign.runs[0].signals["current"])
    assert np.flatnonzero(missing_samples).tolist() == [500] and len(campaign.runs[0].time) == 1351


def test_samples_out_of_order_are_left_out(folder):
    modify_table(folder, "run3.csv", lambda f: pd.concat([f[:500], f[480:]]))
    campaign = read_campaign(folder)
    remark = only_error_or_warning(campaign.remarks)
    assert remark.line == 502 and "left out up to line 521" in remark.sentence
    assert (np.diff(campaign.runs[0].time) > 0).all() and len(campaign.runs[0].time) == 1351


def test_a_campaign_without_a_usable_run_is_an_error(folder):
    for run in ("run3.csv", "run4.csv", "run8.csv"):
        (folder / run).write_text("a;b\n1;2\n")
    with pytest.raises(CampaignError, match="no run can be used"):
        read_campaign(folder)
    with pytest.raises(CampaignError, match="no such file"):
        read_campaign(folder / "elsewhere")


def test_all_problems_of_a_campaign_are_told_at_once(tmp_path):
    (tmp_path / "campaign.yaml").write_text(
        "rig: pump_bench\n"
        "uncertain: {mover_dampin: 0.25}\n"
        "signals:\n  voltage: {unit: Vx, noise: 1}\n  courrent: {unit: A}\n"
        "runs:\n  - {file: none.csv, use: fitt, frequency: 10 s}\n"
    )
    with pytest.raises(CampaignError) as refused:
        read_campaign(tmp_path)
    lines = str(refused.value).splitlines()
    wrong = "mover_dampin", "signals.voltage.unit", "signals.courrent", "runs[0].use", "runs[0].frequency", "none.csv"
    for part in wrong:
        assert sum(part in line for line in lines) == 1


@pytest.mark.parametrize(
    ("limits", "said"),
    [("[0 MPa, 10 MPa]", ""), ("[0 Pa, 10 Pa]", "are they in MPa?"), ("[8 MPa, 9 MPa]", "of this sensor?")],
)
def test_limits_that_exclude_most_samples_are_said_with_the_likely_unit(folder, limits, said):
    replace_in_yaml(folder, "outlet_pressure: {unit: MPa,", f"outlet_pressure: {{limits: {limits}, unit: MPa,")
    remarks = [str(remark) for remark in read_campaign(folder).remarks]
    assert len(remarks) == bool(said) and all("samples lie outside the stated limits" in r for r in remarks)
    assert not said or said in remarks[0]
