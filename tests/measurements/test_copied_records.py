"""Samples that are in a campaign twice."""

from pathlib import Path

import numpy as np

from edhas_jax.measurements.campaign import BenchRun, Use
from edhas_jax.measurements.checks import copied_records
from edhas_jax.measurements.checks.copied_records import check_copies

TIME = 0.01 * np.arange(600)


def noisy(seed, resolution=0.0):
    values = np.sin(0.7 * TIME) + 0.02 * np.random.default_rng(seed).standard_normal(len(TIME))
    return resolution * np.round(values / resolution) if resolution else values


def run(name, use=Use.FIT, part=slice(None), **signals):
    signals = {signal: values[part] for signal, values in signals.items()}
    time = TIME[part]
    return BenchRun(name, Path(f"{name}.csv"), use, {}, time - time[0], signals, np.arange(len(time)) + 2)


def sentences(*runs):
    return [remark.sentence for remark in check_copies(runs)]


def test_repeated_measurements_are_no_copies():
    runs = [run(f"r{k}", pressure=noisy(k, 0.01), flow=noisy(10 + k, 0.01)) for k in range(8)]
    assert not sentences(*runs)


def test_a_run_under_two_names_is_said():
    (found,) = sentences(run("a", pressure=noisy(1)), run("b", pressure=noisy(1)), run("c", pressure=noisy(2)))
    assert found.startswith("all samples are those of a to the last digit; they count twice")


def test_a_held_out_copy_tests_nothing():
    (found,) = sentences(run("a", pressure=noisy(1)), run("b", Use.HOLDOUT, pressure=noisy(1)))
    assert "tests nothing" in found


def test_windows_that_overlap_are_said_and_others_not():
    first, overlapping, later = slice(0, 400), slice(300, 600), slice(400, 600)
    (found,) = sentences(run("a", part=first, pressure=noisy(1)), run("b", part=overlapping, pressure=noisy(1)))
    assert found.startswith("28 % of the samples are those of a")  # 77 of 277 sequences
    assert not sentences(run("a", part=first, pressure=noisy(1)), run("b", part=later, pressure=noisy(1)))


def test_the_same_command_in_two_runs_is_no_copy():
    command = np.round(np.sin(3.0 * TIME), 4)
    assert not sentences(run("a", voltage=command, pressure=noisy(1)), run("b", voltage=command, pressure=noisy(2)))


def test_a_machine_at_rest_is_no_copy():
    rest = np.zeros(len(TIME))
    assert not sentences(run("a", flow=rest, pressure=noisy(1)), run("b", flow=rest, pressure=noisy(2)))


def test_missing_samples_are_no_copy():
    gap = np.where((TIME > 1.0) & (TIME < 5.0), np.nan, noisy(1))
    other = np.where((TIME > 1.0) & (TIME < 5.0), np.nan, noisy(2))
    assert not sentences(run("a", pressure=gap), run("b", pressure=other))


def test_two_signals_of_one_column_are_said():
    (found,) = sentences(run("a", head_pressure=noisy(1), rod_pressure=noisy(1), flow=noisy(3)))
    assert found.startswith("head_pressure and rod_pressure hold the same samples")


def test_a_copy_is_found_among_records_of_which_a_part_is_compared(monkeypatch):
    monkeypatch.setattr(copied_records, "MOST_SEQUENCES", 400)
    (found,) = sentences(*(run(f"r{k}", pressure=noisy(k % 5)) for k in range(6)))
    assert found.startswith("all samples are those of r0")
