"""The clock of a logger may start anywhere, and a window limits what is used of a record."""

import numpy as np
import pandas as pd
import pytest

from edhas_jax.commands.cli import main
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.comparison import compare
from tests.support.faulty_campaign import VALID_CAMPAIGN, copy_campaign, modify_table, replace_in_yaml

TIME = "time [ms]"
RUNS = ("run3.csv", "run4.csv", "run8.csv")
EPOCH = 1.7e9  # s


@pytest.fixture(scope="module")
def unchanged():
    return read_campaign(VALID_CAMPAIGN)


def with_clock(folder, offset):
    """A copy of the valid campaign whose logger started at `offset` [s]."""
    copy_campaign(folder)
    for run in RUNS:
        path = folder / run
        lines = path.read_text().splitlines()
        rows = [line.split(",", 1) for line in lines[1:]]
        shifted = [f"{1e3 * offset + float(time):.6f},{rest}" for time, rest in rows]
        path.write_text("\n".join([lines[0], *shifted]) + "\n")
    return folder


@pytest.mark.parametrize("offset", [10.0, 300.0, 3000.0, -7.0, EPOCH])
def test_a_logger_clock_may_start_anywhere(offset, unchanged, tmp_path):
    campaign = read_campaign(with_clock(tmp_path / "bench", offset))
    for run, expected in zip(campaign.runs, unchanged.runs, strict=True):
        np.testing.assert_allclose(run.time, expected.time, rtol=0, atol=1e-9)
        assert run.time[0] == 0.0 and run.interval == pytest.approx(expected.interval, rel=1e-9)
        for name, values in expected.signals.items():
            np.testing.assert_array_equal(run.signals[name], values)
    assert all("time is counted from there" in remark.sentence for remark in campaign.remarks)


def test_compare_has_the_same_residuals_for_any_start_of_the_clock(unchanged, tmp_path):
    shifted = compare(read_campaign(with_clock(tmp_path / "bench", EPOCH))).rms_over_noise()
    for run, expected in compare(unchanged).rms_over_noise().items():
        assert shifted[run] == pytest.approx(expected, rel=1e-3)


def test_a_stated_start_is_time_zero_and_samples_before_it_are_not_used(unchanged, tmp_path):
    folder = with_clock(tmp_path / "bench", 4.9)

    def with_samples_before(frame):
        before = frame[:500].assign(**{TIME: frame[TIME][:500] - 100.0})
        return pd.concat([before, frame])

    modify_table(folder, "run3.csv", with_samples_before)
    replace_in_yaml(folder, "run3.csv, use: fit,", "run3.csv, use: fit, start: 4.9 s,")
    run = read_campaign(folder).runs[0]
    np.testing.assert_allclose(run.time, unchanged.runs[0].time, atol=1e-9)
    np.testing.assert_allclose(run.signals["current"], unchanged.runs[0].signals["current"], atol=1e-5)


def test_a_window_limits_what_is_compared(unchanged, tmp_path):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "run3.csv, use: fit,", "run3.csv, use: fit, window: {from: 0.1 s, to: 200 ms},")
    campaign = read_campaign(folder)
    time = campaign.runs[0].time
    assert (time[0], time[-1]) == pytest.approx((0.1, 0.2))
    inside, whole = compare(campaign).runs[0], compare(unchanged).runs[0]
    used = (whole.run.time > 0.1 - 1e-9) & (whole.run.time < 0.2 + 1e-9)
    for name, residual in inside.residuals.items():
        np.testing.assert_allclose(residual, whole.residuals[name][used], atol=0.05)


@pytest.mark.parametrize(
    ("entry", "problem"),
    [
        ("window: 0.2 s", "window: {from: 0.2 s, to: 1.5 s}"),
        ("window: {from: 0.2 s, until: 1 s}", "unknown key"),
        ("window: {from: 1 s, to: 0.5 s}", "`to` later than `from`"),
        ("window: {from: 1 mm}", "mm"),
        ("start: noon", "noon"),
        ("window: {from: 50 s}", "the record lasts from"),
    ],
)
def test_a_wrong_window_or_start_is_one_sentence(entry, problem, tmp_path, capsys):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "run3.csv, use: fit,", f"run3.csv, use: fit, {entry},")
    assert main(["campaign", "check", str(folder)]) in (1, 2)
    captured = capsys.readouterr()
    assert problem in " ".join((captured.out + captured.err).split())


def test_a_jump_of_the_clock_leaves_the_shorter_part_out(tmp_path):
    folder = copy_campaign(tmp_path / "bench")

    def with_jump(frame):
        return frame.assign(**{TIME: frame[TIME] + np.where(np.arange(len(frame)) > 1000, 9000.0, 0.0)})

    modify_table(folder, "run3.csv", with_jump)
    campaign = read_campaign(folder)
    assert campaign.runs[0].time[-1] == pytest.approx(0.2)
    assert any("time jumps from" in remark.sentence for remark in campaign.remarks)


def test_a_window_holds_in_a_plan_and_in_a_written_campaign(unchanged, tmp_path):
    from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign
    from studies.campaign_writer import write_campaign

    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, "run3.csv, use: fit,", "run3.csv, use: fit, window: {from: 0.1 s, to: 0.2 s},")
    windowed = read_campaign(folder)
    write_campaign(windowed, tmp_path / "copy")
    np.testing.assert_allclose(read_campaign(tmp_path / "copy").runs[0].time, windowed.runs[0].time, atol=1e-9)
    (folder / "run3.csv").unlink()
    planned = read_planned_campaign(folder, 5000.0).runs[0]
    assert (planned.time[0], planned.time[-1]) == pytest.approx((0.1, 0.2))


def test_a_bench_that_was_running_when_its_record_began(unchanged, tmp_path):
    """Without the first three cycles of a run there is no rest in it: the model runs in, and agrees as with them."""
    folder = copy_campaign(tmp_path / "bench")
    begin = 3 / 20.0  # s, at 20 Hz: after the ramp
    modify_table(folder, "run3.csv", lambda frame: frame[frame[TIME] >= 1e3 * begin - 1e-6])
    from_rest = compare(read_campaign(folder)).rms_over_noise()["run3"]
    replace_in_yaml(folder, "run3.csv, use: fit,", "run3.csv, use: fit, running: yes,")
    run = read_campaign(folder).runs[0]
    assert run.time[0] == pytest.approx((np.ceil(0.1 * 20.0) + 10) / 20.0)
    running = compare(read_campaign(folder)).rms_over_noise()["run3"]
    (whole,) = (r for r in compare(unchanged).runs if r.run.name == "run3")
    same_time = whole.run.time >= begin
    for name, value in running.items():
        expected = float(np.sqrt(np.nanmean(np.square(whole.residuals[name][same_time]))))
        assert value == pytest.approx(expected, rel=0.01) and from_rest[name] > 1.5 * value, name


@pytest.mark.parametrize(("old", "new", "message"), [
    ("run3.csv, use: fit,", "run3.csv, use: fit, running: 3,", "yes or no belongs here"),
    ("runs:", "reference: {kind: step, step_size: 1 mm}\nruns:", None),
])  # fmt: skip
def test_what_cannot_run_in_is_refused(old, new, message, tmp_path):
    folder = copy_campaign(tmp_path / "bench")
    replace_in_yaml(folder, old, new)
    if message is None:
        for name in RUNS:
            text = (folder / "campaign.yaml").read_text()
            conditions = text.partition(f"{name}, use: ")[2].partition("}")[0]
            text = text.replace(conditions, conditions.partition(",")[0] + ", running: yes")
            (folder / "campaign.yaml").write_text(text)
        message = "only its cycles say what came before"
    with pytest.raises(ValueError, match=message):
        read_campaign(folder)
