"""Drives that step: two rows at one time, and set points that a computer holds; the exact answer of a lag to them."""

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core.remark import Severity
from edhas_jax.measurements.accuracy import RecorderClock
from edhas_jax.measurements.campaign import CampaignError
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.clock_alignment import shifted

TAU, GAIN, NOISE = 0.1, 20.0, 0.02  # s, bar/V, bar
LEVELS = np.array([0.05, 2.0, 0.8, 2.5, 1.2])  # V
ON_SAMPLES, BETWEEN_SAMPLES = np.array([0.5, 1.2, 2.0, 2.9]), np.array([0.5137, 1.2213, 2.0071, 2.9291])  # s
RIG = '''
from edhas_jax import Rig, drive, par, state

class Lag(Rig):
    """One lag: p' = (gain u - p) / tau."""

    time_step, duration = 1e-3, 4.0

    command = drive("V", "command of the valve", 1.0)
    gain: float = par(2.2e6, "Pa/V", (1e4, 1e8), "pressure per voltage")
    tau: float = par(0.08, "s", (1e-3, 10.0), "time constant")
    pressure = state("Pa", "pressure at the outlet", 1e5)

    def equations(self, y, s):
        return {"pressure": (self.gain * s.command - y.pressure) / self.tau}
'''


def exact_pressure(time, steps):
    """The pressure [bar] at times (n,) [s] after the steps at the times `steps` [s]."""
    found, begin, value = np.full(len(time), 1.0), 0.0, 1.0
    for at, level in zip([*steps, np.inf], LEVELS, strict=True):
        goes_on = GAIN * level + (value - GAIN * level) * np.exp(-(time - begin) / TAU)
        found = np.where(time >= begin, goes_on, found)
        value, begin = GAIN * level + (value - GAIN * level) * np.exp(-(at - begin) / TAU), at
    return found


def write_campaign(folder, steps, two_rows: bool, jitter=0.0, drive="{column: u, unit: V}"):
    """A folder with one run of 4 s, sampled every 50 ms, and with a second row at each step where `two_rows` is set."""
    rng = np.random.default_rng(5)
    time = np.round(0.05 * np.arange(81), 6)
    time[1:-1] += 0.05 * jitter * rng.uniform(-1.0, 1.0, 79)
    if two_rows:
        time = np.sort(np.concatenate([np.setdiff1d(time, steps), steps, steps]))
    is_first = np.append(np.diff(time) == 0.0, False)
    command = np.where(is_first, LEVELS[np.searchsorted(steps, time)], LEVELS[np.searchsorted(steps, time, "right")])
    pressure = exact_pressure(time, steps) + NOISE * rng.standard_normal(len(time))
    rows = (f"{t:.10g},{u:.6g},{p:.8g}" for t, u, p in zip(time, command, pressure, strict=True))
    (folder / "run.csv").write_text("\n".join(["time [s],u,p", *rows, ""]))
    (folder / "lag.py").write_text(RIG)
    (folder / "campaign.yaml").write_text(
        f"rig: lag.py:Lag\ndrives: {{command: {drive}}}\nuncertain: {{gain: 0.2, tau: 0.5}}\n"
        f"signals: {{pressure: {{column: p, unit: bar, noise: {NOISE}}}}}\nruns: [{{file: run.csv, use: fit}}]\n"
    )
    return read_campaign(folder, trust=[folder / "lag.py"])


@pytest.mark.parametrize(
    ("steps", "two_rows", "jitter", "drive"),
    [
        (ON_SAMPLES, True, 0.0, "{column: u, unit: V}"),
        (ON_SAMPLES, False, 0.0, "{column: u, unit: V, between: hold}"),
        (BETWEEN_SAMPLES, True, 0.0, "{column: u, unit: V}"),
        (BETWEEN_SAMPLES, True, 0.3, "{column: u, unit: V, between: hold}"),
    ],
    ids=["two rows", "held", "between samples", "irregular"],
)
def test_a_lag_that_is_driven_by_steps_is_identified(tmp_path, steps, two_rows, jitter, drive):
    campaign = write_campaign(tmp_path, steps, two_rows, jitter, drive)
    assert not [r for r in campaign.remarks if r.severity is not Severity.NOTE]
    recorded = campaign.runs[0].drives["command"].steps
    np.testing.assert_allclose(recorded.times, steps, rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.diff(recorded.levels), np.diff(LEVELS), rtol=0, atol=1e-12)
    fit = edhas.fit(campaign).fit
    assert fit.values["tau"] == pytest.approx(TAU, rel=3e-3) and fit.values["gain"] == pytest.approx(2e6, rel=1e-3)


def test_a_drive_that_stays_and_jumps_is_asked_for(tmp_path):
    """Without a second row and without a word, a step would be taken for a ramp of one sample interval."""
    for more, count in (("", 1), (", between: line", 0), (", between: hold", 0)):
        campaign = write_campaign(tmp_path, ON_SAMPLES, False, drive=f"{{column: u, unit: V{more}}}")
        assert ["`u` stays and jumps" in r.sentence for r in campaign.remarks] == [True] * count


def test_at_a_step_a_measured_signal_counts_as_in_the_last_row(tmp_path):
    """A flow that follows the command at once has both values at that time; the model has the later one."""
    (tmp_path / "flow.py").write_text(RIG.replace("        return", "        s.set(copy=s.command)\n        return")
                                      .replace("    def eq", '    copy = signal("V", "the command")\n\n    def eq')
                                      .replace("import Rig", "import signal, Rig"))  # fmt: skip
    rows = [(0.1 * k, 1.0 + (k > 7), 1.0 + (k > 7)) for k in range(15)]
    rows.insert(7, (0.7, 1.0, 1.0))
    rows[8] = (0.7, 2.0, 2.0)
    text = "".join(f"{t:.6g},{u},{c}\n" for t, u, c in rows)
    (tmp_path / "run.csv").write_text("time [s],u [V],c [V]\n" + text)
    (tmp_path / "campaign.yaml").write_text(
        "rig: flow.py:Lag\ndrives: {command: u}\nsignals: {copy: {column: c, unit: V, noise: 0.01}}\n"
        "runs: [{file: run.csv, use: fit}]\n"
    )
    campaign = read_campaign(tmp_path, trust=[tmp_path / "flow.py"])
    (run,) = campaign.runs
    np.testing.assert_allclose(run.time, np.arange(15) * 0.1, rtol=1e-15)
    np.testing.assert_array_equal(run.signals["copy"], np.where(np.arange(15) < 7, 1.0, 2.0))
    (remark,) = campaign.remarks
    assert remark.line == 10 and "the drives step in 1 place" in remark.sentence
    shown = edhas.simulate(campaign.machine, edhas.Simulation(duration=1.4, sample_rate=10.0)).signals["copy"]
    np.testing.assert_allclose(shown, run.signals["copy"], atol=1e-12)


def test_rows_at_one_time_that_are_no_step_are_left_out_as_before(tmp_path):
    held = "{column: u, unit: V, between: hold}"
    campaign = write_campaign(tmp_path, ON_SAMPLES, two_rows=False, drive=held)
    lines = (tmp_path / "run.csv").read_text().splitlines()
    lines.insert(30, lines[29])
    (tmp_path / "run.csv").write_text("\n".join([*lines, ""]))
    again = read_campaign(tmp_path, trust=[tmp_path / "lag.py"])
    assert ["does not come after" in r.sentence for r in again.remarks] == [True]
    np.testing.assert_array_equal(again.runs[0].time, campaign.runs[0].time)


def test_the_steps_of_a_late_recorder_are_shifted_as_steps(tmp_path):
    campaign = write_campaign(tmp_path, ON_SAMPLES, two_rows=True)
    (run,) = shifted((campaign.runs[0],), RecorderClock(("command",), 0.1), 0.03)
    np.testing.assert_allclose(run.drives["command"].steps.times, ON_SAMPLES - 0.03)
    assert run.drives["command"].value_and_rate(1.18)[0] == pytest.approx(0.8)


def test_another_word_for_between_is_refused_with_its_place(tmp_path):
    with pytest.raises(CampaignError, match=r"drives.command.between: one of line, hold belongs here; got held"):
        write_campaign(tmp_path, ON_SAMPLES, False, drive="{column: u, unit: V, between: held}")
