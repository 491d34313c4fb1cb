"""Channels of different rates in one run: several files, groups of one file, blank rows; a stated sampling interval."""


import h5py
import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.inference.likelihood.whitening import whiten
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel

RIG = '''"""A valve that heats its oil: the pressure follows the command fast, the temperature the pressure slowly."""
from edhas_jax import Rig, drive, par, signal, state


class Heated(Rig):
    """Two lags, one after the other."""

    time_step, duration = 2e-3, 30.0
    command = drive("V", "command of the valve", 0.0)
    gain: float = par(2.0e6, "Pa/V", (1e4, 1e8), "pressure per voltage")
    fast: float = par(0.03, "s", (1e-3, 10.0), "time constant of the pressure")
    slow: float = par(1.5, "s", (0.1, 100.0), "time constant of the temperature")
    heat: float = par(4e-6, "K/Pa", (1e-8, 1e-3), "rise of the temperature per pressure")
    start: float = par(293.15, "K", (200.0, 500.0), "temperature at the start")
    pressure = state("Pa", "pressure at the outlet")
    oil = state("K", "temperature of the oil", "start")

    def equations(self, y, s):
        rise = self.heat * y.pressure - (y.oil - self.start)
        return {"pressure": (self.gain * s.command - y.pressure) / self.fast, "oil": rise / self.slow}
'''
TRUTH = {"gain": 2.1e6, "fast": 0.04, "slow": 2.0, "heat": 5e-6}
DURATION, FINE = 20.0, 1e-3
NOISE = {"pressure": 4e3, "oil": 0.05}
CORRELATION = 0.6  # of the noise of the thermometer, from one of its samples to the next
FAST, SLOW, COMMAND = 5, 100, 20  # 200 Hz, 10 Hz, 50 Hz


def truth():
    """Time (n,) in steps of 1 ms, command, pressure and temperature."""
    t = FINE * np.arange(round(DURATION / FINE) + 1)
    u = 1.0 + 0.5 * np.sin(2.0 * np.pi * 0.3 * t) + 0.4 * np.sin(2.0 * np.pi * 1.1 * t + 0.4)
    p, oil = np.zeros(len(t)), np.full(len(t), 293.15)
    for k in range(len(t) - 1):
        middle = 0.5 * (u[k] + u[k + 1])
        p[k + 1] = p[k] + (1.0 - np.exp(-FINE / TRUTH["fast"])) * (TRUTH["gain"] * middle - p[k])
        level = 293.15 + TRUTH["heat"] * 0.5 * (p[k] + p[k + 1])
        oil[k + 1] = oil[k] + (1.0 - np.exp(-FINE / TRUTH["slow"])) * (level - oil[k])
    return t, u, p, oil


T, U, P, OIL = truth()


def measured(every, values, name, seed):
    """Every so many samples with noise; that of the thermometer is autoregressive."""
    values, rng = values[::every], np.random.default_rng(seed)
    noise = rng.standard_normal(len(values))
    if name == "oil":
        for k in range(1, len(noise)):
            noise[k] = CORRELATION * noise[k - 1] + np.sqrt(1.0 - CORRELATION**2) * noise[k]
    return values + NOISE[name] * noise


def csv(folder, name, header, *columns):
    cells = [["" if np.isnan(v) else f"{v:.7g}" for v in column] for column in columns]
    (folder / name).write_text("\n".join([header, *map(",".join, zip(*cells, strict=True))]) + "\n")


PRESSURE, TEMPERATURE = measured(FAST, P, "pressure", 1), measured(SLOW, OIL, "oil", 2)


def campaign(folder, run, signals="pressure: {column: p, unit: Pa}, oil: {column: T, unit: K}", more="", drive="u"):
    (folder / "heated.py").write_text(RIG)
    (folder / "campaign.yaml").write_text(
        f"name: heated\nrig: heated.py:Heated\ndrives: {{command: {drive}}}\n"
        f"uncertain: {{gain: 0.3, fast: 0.5, slow: 0.5, heat: 0.5}}\nsignals: {{{signals}}}\n{more}runs: [{{{run}}}]\n"
    )
    return read_campaign(folder, [folder / "heated.py"])


@pytest.fixture
def three_rates(tmp_path):
    """A run in two files: pressure at 200 Hz, and from another recorder command at 50 Hz and temperature at 10 Hz."""
    csv(tmp_path, "daq.csv", "time [s],p [Pa]", T[::FAST], PRESSURE)
    blank = np.full(len(T[::COMMAND]), np.nan)
    blank[:: SLOW // COMMAND] = TEMPERATURE
    csv(tmp_path, "plc.csv", "time [s],u [V],T [K]", T[::COMMAND], U[::COMMAND], blank)
    signals = "pressure: {column: p, unit: Pa}, oil: {column: T, unit: K, noise: 0.05}"
    return campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit", signals)


def test_every_rate_has_its_own_time_and_nothing_is_left_out(three_rates):
    pressure, oil = three_rates.runs
    assert (pressure.name, oil.name, oil.part_of) == ("daq", "daq, oil", "daq")
    assert (pressure.interval, oil.interval) == (pytest.approx(0.005), pytest.approx(0.1))
    assert pressure.valid_samples == len(PRESSURE) and oil.valid_samples == len(TEMPERATURE)
    assert pressure.drives["command"].interval == pytest.approx(0.02) and oil.drives is pressure.drives
    assert not [r for r in three_rates.remarks if "left out" in r.sentence or "missing" in r.sentence]
    assert any("oil: a value in every 5th row" in r.sentence for r in three_rates.remarks)


def test_the_noise_of_a_slow_channel_is_that_from_one_of_its_samples_to_the_next(tmp_path):
    """In every tenth row of a table it is measured, and whitened, as in a table of its own."""
    count, level = 3000, np.full(3000, 293.15)
    oil = measured(1, level, "oil", 3)
    fast = measured(1, np.zeros(10 * count), "pressure", 4)
    blank = np.full(10 * count, np.nan)
    blank[::10] = oil
    time, none = 0.01 * np.arange(10 * count), np.zeros(10 * count)
    csv(tmp_path, "all.csv", "time [s],u [V],p [Pa],T [K]", time, none, fast, blank)
    csv(tmp_path, "alone.csv", "time [s],u [V],T [K]", time[::10], none[::10], oil)
    together = checked_campaign(campaign(tmp_path, "file: all.csv, use: fit"))
    alone = checked_campaign(campaign(tmp_path, "file: alone.csv, use: fit", "oil: {column: T, unit: K}"))
    channel = together.channels["oil"]
    assert (channel.noise, channel.correlation) == (alone.channels["oil"].noise, alone.channels["oil"].correlation)
    assert channel.noise == pytest.approx(NOISE["oil"], rel=0.1)
    assert channel.correlation[0] == pytest.approx(CORRELATION, abs=0.1)
    assert together.channels["pressure"].noise == pytest.approx(NOISE["pressure"], rel=0.05)
    innovations = whiten(together.runs[1].signals["oil"] - 293.15, channel)
    assert np.isfinite(innovations).sum() == count - len(channel.correlation)
    assert np.nanstd(innovations) == pytest.approx(1.0, abs=0.1)


def test_the_parameters_of_a_machine_come_right_from_three_rates(three_rates):
    found = edhas.fit(three_rates, starts=1)
    for name, value in TRUTH.items():
        assert abs(found.fit.values[name] - value) < 4.0 * found.fit.standard_errors[name], name
        assert found.fit.values[name] == pytest.approx(value, rel=0.05)
    assert found.drift.runs == ("daq",)  # the parts of one run are no runs
    error = found.rms_residuals()["calibrated"]["fit"]
    assert error["pressure"] == pytest.approx(1.0, abs=0.1)


def test_the_parts_of_a_run_are_simulated_once(three_rates, monkeypatch):
    from edhas_jax.measurements import measurement_model

    calls = []
    simulate = measurement_model.simulate_batch
    monkeypatch.setattr(measurement_model, "simulate_batch", lambda *a: calls.append(a[5]) or simulate(*a))
    model = MeasurementModel(three_rates, three_rates.machine, (), three_rates.runs)
    together = model.predict_all_runs(np.zeros(0), 4)
    assert [list(counts) for counts in calls] == [[len(PRESSURE)]]
    assert model.longest_interval() == pytest.approx(0.005)
    for r, run in enumerate(three_rates.runs):
        alone = MeasurementModel(three_rates, three_rates.machine, (), (run,))
        steps = round(run.interval / 0.005) * 4
        assert together[r].values["oil"] == pytest.approx(alone.predict_all_runs(np.zeros(0), steps)[0].values["oil"])


def test_groups_of_one_file_keep_their_own_times(tmp_path):
    with h5py.File(tmp_path / "run.h5", "w") as file:
        for name, every, columns in (("daq", FAST, {"p": PRESSURE}), ("plc", SLOW, {"T": TEMPERATURE}),
                                     ("drive", COMMAND, {"u": U[::COMMAND]})):  # fmt: skip
            group = file.create_group(name)
            group["time"] = T[::every] + 100.0
            group["time"].attrs["unit"] = "s"
            for column, values in columns.items():
                group[column] = values
                group[column].attrs["unit"] = {"p": "Pa", "T": "K", "u": "V"}[column]
    pressure, oil = campaign(tmp_path, "file: run.h5, use: fit").runs
    assert pressure.valid_samples == len(PRESSURE) and oil.valid_samples == len(TEMPERATURE)
    assert pressure.time[0] == oil.time[0] == 0.0 and pressure.drives["command"].interval == pytest.approx(0.02)


def test_records_that_overlap_have_one_clock_and_others_their_own(tmp_path):
    csv(tmp_path, "daq.csv", "time [s],p [Pa],u [V]", 50.0 + T[::FAST], PRESSURE, U[::FAST])
    csv(tmp_path, "plc.csv", "time [s],T [K]", 50.0 + T[::SLOW][3:], TEMPERATURE[3:])
    pressure, oil = campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit").runs
    assert pressure.time[0] == 0.0 and oil.time[0] == pytest.approx(0.3)
    csv(tmp_path, "plc.csv", "time [s],T [K]", 9e5 + T[::SLOW], TEMPERATURE)
    found = campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit")
    assert found.runs[1].time[0] == 0.0
    assert any("plc.csv" in str(r) and "its clock starts at" in r.sentence for r in found.remarks)
    found = campaign(tmp_path, "files: [daq.csv, {file: plc.csv, start: 900000.4 s}], use: fit")
    oil = found.runs[1]
    assert oil.time[0] == pytest.approx(0.0, abs=1e-9) and oil.signals["oil"][0] == pytest.approx(TEMPERATURE[4])


@pytest.mark.parametrize("time", ["interval: 5 ms", "rate: 200 Hz"])
def test_a_stated_interval_takes_the_place_of_a_time_column(tmp_path, time):
    csv(tmp_path, "daq.csv", "p [Pa],u [V]", PRESSURE, U[::FAST])
    found = campaign(tmp_path, "file: daq.csv, use: fit", "pressure: {column: p, unit: Pa}", f"time: {{{time}}}\n")
    assert found.runs[0].time == pytest.approx(T[::FAST], abs=1e-9)
    assert not found.remarks
    with pytest.raises(CampaignError, match="time: either the column of the time stamps, or the interval"):
        campaign(tmp_path, "file: daq.csv, use: fit", more="time: {column: t, rate: 1 kHz}\n")
    with pytest.raises(CampaignError, match="time.interval: must be above 0"):
        campaign(tmp_path, "file: daq.csv, use: fit", more="time: {interval: 0 s}\n")


def test_a_run_may_name_its_columns_and_its_interval(tmp_path):
    csv(tmp_path, "old.csv", "pr,cmd [V]", PRESSURE / 1e5, U[::FAST])
    run = "file: old.csv, use: fit, time: {interval: 5 ms}, columns: {pressure: {column: pr, unit: bar}, command: cmd}"
    (run,) = campaign(tmp_path, run, "pressure: {column: p, unit: Pa}").runs
    assert run.signals["pressure"] == pytest.approx(PRESSURE, rel=1e-5)
    assert np.asarray(run.drives["command"].values) == pytest.approx(U[::FAST], rel=1e-5)
    with pytest.raises(CampaignError, match="columns.presure: is neither a signal nor a recorded drive .* pressure"):
        campaign(tmp_path, "file: old.csv, use: fit, columns: {presure: pr}")


@pytest.mark.parametrize("header, drive", [("u", "u"), ("u [-]", "u"), ("u", '{column: u, unit: "-"}')])
def test_a_drive_without_dimension_needs_no_unit(tmp_path, header, drive):
    (tmp_path / "heated.py").write_text(RIG.replace('drive("V"', 'drive("-"').replace('"Pa/V"', '"Pa"'))
    csv(tmp_path, "daq.csv", f"p [Pa],{header}", PRESSURE, U[::FAST])
    text = (
        f"rig: heated.py:Heated\ndrives: {{command: {drive}}}\ntime: {{rate: 200 Hz}}\n"
        "signals: {pressure: {column: p, unit: Pa}}\nruns: [{file: daq.csv, use: fit}]\n"
    )
    (tmp_path / "campaign.yaml").write_text(text)
    (run,) = read_campaign(tmp_path, [tmp_path / "heated.py"]).runs
    np.testing.assert_allclose(run.drives["command"].values, U[::FAST], rtol=1e-6)  # seven digits in the file


def test_a_column_in_two_files_is_asked_for(tmp_path):
    csv(tmp_path, "daq.csv", "time [s],p [Pa],u [V]", T[::FAST], PRESSURE, U[::FAST])
    csv(tmp_path, "plc.csv", "time [s],p [Pa],T [K]", T[::SLOW], P[::SLOW], TEMPERATURE)
    found = campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit")
    assert any("several columns `p`; write `pressure: {column: daq/p}`, or plc/p" in r.sentence for r in found.remarks)
    found = campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit, columns: {pressure: daq/p}")
    assert found.runs[0].valid_samples == len(PRESSURE)


def test_a_parameter_called_start_and_the_start_of_a_run_are_told_apart(tmp_path):
    csv(tmp_path, "daq.csv", "time [s],p [Pa],u [V]", T[::FAST], PRESSURE, U[::FAST])
    signals = "pressure: {column: p, unit: Pa}"
    with pytest.raises(CampaignError) as refused:
        campaign(tmp_path, "file: daq.csv, use: fit, start: 300 K", signals)
    assert "`conditions: {start: …}`; for the time at which the run begins `time: {start: …}`" in str(refused.value)
    (run,) = campaign(
        tmp_path, "file: daq.csv, use: fit, time: {start: 1 s}, conditions: {start: 300 K}", signals
    ).runs  # fmt: skip
    assert run.conditions == {"start": 300.0}
    assert run.time[run.lines == 2 + 200] == pytest.approx([0.0], abs=1e-9)


def held(values, every, first=0):
    """Samples as a recorder writes them that asks more often than the sensor measures, from a row on."""
    return np.repeat(values, every)[first:]


@pytest.mark.parametrize(("every", "first"), [(2, 0), (4, 0), (4, 3)])
def test_a_signal_that_a_faster_recorder_repeats_counts_once(tmp_path, every, first):
    """The repetitions at the ends and at the extremes too: they are late, and no second measurement."""
    time = 0.005 * np.arange(every * 1000 - first)
    values = measured(4 * FAST, P, "pressure", 1)[:1000]
    csv(tmp_path, "all.csv", "time [s],u [V],p [Pa]", time, np.sin(time), held(values, every, first))
    found = campaign(tmp_path, "file: all.csv, use: fit", "pressure: {column: p, unit: Pa, noise: 4e3}")
    (run,) = found.runs
    assert run.interval == pytest.approx(0.005 * every)
    # the first measurement was made before the record where the recorder began within it
    assert run.signals["pressure"] == pytest.approx(values[int(first > 0) :], rel=1e-6)
    assert run.time[0] == pytest.approx(0.005 * ((every - first) % every))
    assert any(f"pressure: a new value only every {every} rows" in r.sentence for r in found.remarks)


@pytest.mark.parametrize("values", [
    np.round(np.linspace(0.0, 90.0, 4000)), np.round(30.0 * np.sin(np.linspace(0.0, 20.0, 4000))),
    np.round(20.0 * np.sin(0.01 * np.arange(4000)) + 0.3 * np.random.default_rng(0).standard_normal(4000)),
    np.repeat([1.0, 3.0, 2.0, 5.0, 4.0], 800), np.random.default_rng(0).standard_normal(4000),
])  # fmt: skip
def test_a_signal_of_coarse_resolution_keeps_its_samples(tmp_path, values):
    csv(tmp_path, "all.csv", "time [s],u [V],p [Pa]", 0.005 * np.arange(4000), np.zeros(4000), values)
    (run,) = campaign(tmp_path, "file: all.csv, use: fit", "pressure: {column: p, unit: Pa, noise: 1}").runs
    assert run.valid_samples == 4000


def test_a_signal_that_rests_meanwhile_keeps_its_rate(tmp_path):
    values = measured(FAST, P, "pressure", 1)[:800].copy()
    values[300:320] = values[300]
    csv(tmp_path, "all.csv", "time [s],u [V],p [Pa]", 0.005 * np.arange(3200), np.zeros(3200), held(values, 4))
    (run,) = campaign(tmp_path, "file: all.csv, use: fit", "pressure: {column: p, unit: Pa}").runs
    assert run.signals["pressure"] == pytest.approx(values, rel=1e-6)


def test_a_time_column_that_contradicts_the_stated_interval_is_said(tmp_path):
    csv(tmp_path, "daq.csv", "time [ms],p [Pa],u [V]", 1e3 * T[::FAST], PRESSURE, U[::FAST])
    signals = "pressure: {column: p, unit: Pa}"
    found = campaign(tmp_path, "file: daq.csv, use: fit", signals, "time: {interval: 1 ms}\n")
    assert found.runs[0].interval == pytest.approx(1e-3)
    sentence = "column `time` has a step of 5 ms, the campaign states 1 ms; that is used"
    assert [r.sentence for r in found.remarks] == [sentence]
    assert not campaign(tmp_path, "file: daq.csv, use: fit", signals, "time: {interval: 5 ms}\n").remarks


@pytest.mark.parametrize(("part", "between", "said"), [
    (slice(0, 500), "line", "was not recorded after 9.98 s, the run lasts from 0 s to 20 s"),
    (slice(0, 500), "hold", ""),
    (slice(200, None), "line", "was not recorded before 4 s"),
    (slice(None), "line", ""),
])  # fmt: skip
def test_a_drive_that_is_recorded_for_a_shorter_time_than_the_signals_is_said(tmp_path, part, between, said):
    csv(tmp_path, "daq.csv", "time [s],p [Pa]", T[::FAST], PRESSURE)
    csv(tmp_path, "plc.csv", "time [s],u [V]", T[::COMMAND][part], U[::COMMAND][part])
    signals, drive = "pressure: {column: p, unit: Pa}", f"{{column: u, between: {between}}}"
    found = campaign(tmp_path, "files: [daq.csv, plc.csv], use: fit", signals, drive=drive)
    sentences = [r.sentence for r in found.remarks]
    assert len(sentences) == bool(said) and all(said in sentence for sentence in sentences)


def test_a_drive_that_a_faster_recorder_repeats_in_small_steps_is_asked_about(tmp_path):
    """Taken as a line between all rows it would be late by half of its interval."""
    drive, time = held(U[::FAST], 2), 0.0025 * np.arange(2 * len(PRESSURE))
    csv(tmp_path, "all.csv", "time [s],u [V],p [Pa]", time, drive, np.interp(time, T[::FAST], PRESSURE))
    signals = "pressure: {column: p, unit: Pa}"
    for stated, count in (("u", 1), ("{column: u, between: hold}", 0), ("{column: u, between: line}", 0)):
        found = campaign(tmp_path, "file: all.csv, use: fit", signals, drive=stated)
        assert sum("write `between: hold`" in r.sentence for r in found.remarks) == count
