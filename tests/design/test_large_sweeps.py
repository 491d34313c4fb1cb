"""Sweeps of millions of designs: results go from chunk to file to table without all being in memory."""

import gc
import io
import tracemalloc
import weakref

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.design.sweep import pareto_front, run, table
from edhas_jax.design.sweep.config import Sweep
from edhas_jax.design.sweep.design_selection import few_levels
from edhas_jax.design.sweep.folder import ChunkResult
from edhas_jax.design.sweep.identity import device, versions
from edhas_jax.design.sweep.run import open_sweep, stream_sweep, sweep_parts
from edhas_jax.design.sweep.table import summary_of_parts, windows
from edhas_jax.machine.metrics import METRICS
from edhas_jax.simulation.validity import Status

MACHINE = edhas.PumpBench()


class Results(dict):
    """The results of a chunk, which can be watched."""

    __hash__ = object.__hash__


@pytest.mark.parametrize("size", [1, 7, 64, 1000])
def test_windows_put_every_result_in_its_row(size):
    """Chunks of interleaved groups; none is kept beyond its last row."""
    rng, count = np.random.default_rng(0), 500
    group = rng.integers(0, 3, count)
    rows = [part for g in range(3) for part in np.array_split(np.flatnonzero(group == g), 6)]
    values, alive = rng.random(count), weakref.WeakSet()

    most = 0

    def read(number):
        nonlocal most
        here = Results(flow=values[rows[number]], status=np.zeros(len(rows[number])))
        alive.add(here)
        most = max(most, len(alive))
        return here

    found = [(first, metrics["flow"]) for first, metrics in windows(rows, read, count, size)]
    assert [first for first, _ in found] == list(range(0, count, size))
    np.testing.assert_array_equal(np.concatenate([part for _, part in found]), values)
    assert most <= (6 if size <= 64 else 18)


def made_up(job) -> ChunkResult:
    """Every metric, without a simulation: the first parameter times the number of the metric."""
    column = next(iter(job.values.values()))
    metrics = {n: column * k for k, n in enumerate(METRICS, 1)}
    account = {"cycles": 0 * column + 3, "residual": 0 * column}
    status = np.where(column < 0.011, float(Status.OK), float(Status.STALLED))
    return ChunkResult(job.number, metrics | account | {"status": status}, versions(), device())


def large_sweep(count: int) -> Sweep:
    frequency = np.resize([10.0, 20.0, 30.0, 40.0], count)
    return Sweep(MACHINE, {"piston_diameter": np.linspace(0.009, 0.013, count), "frequency": frequency})


def test_memory_does_not_grow_with_the_results(tmp_path, monkeypatch):
    """Beyond the designs themselves a design takes less than a third of what its results would."""
    monkeypatch.setattr(run, "compute_chunk", made_up)
    monkeypatch.setattr(table, "WINDOW", 8192)
    peaks = []
    for count in (40_000, 160_000):
        sweep = large_sweep(count)
        gc.collect()
        tracemalloc.start()
        stream_sweep(sweep, tmp_path / str(count))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    per_design = (peaks[1] - peaks[0]) / 120_000
    assert per_design < 8 * len(METRICS) / 3, f"{per_design:.0f} bytes per design"


def test_the_parts_of_a_table_are_read_one_after_the_other(tmp_path, monkeypatch):
    """Before the first part is there, less than a quarter of the file has been read."""
    monkeypatch.setattr(run, "compute_chunk", made_up)
    monkeypatch.setattr(table, "WINDOW", 4096)
    stream_sweep(large_sweep(40_000), tmp_path)
    amounts: list[int] = []

    class Counted(io.FileIO):
        def read(self, size=-1):
            found = super().read(size)
            amounts.append(len(found))
            return found

    monkeypatch.setattr(run, "open_listed_file", lambda folder, manifest, name: Counted(folder / name))
    done = [sum(amounts) for _ in sweep_parts(tmp_path)]
    size = (tmp_path / "table.parquet").stat().st_size
    assert len(done) == 10 and done[0] < size / 4 and 0.9 * size < done[-1] < 1.1 * size



def test_the_table_of_a_large_sweep(tmp_path, monkeypatch):
    monkeypatch.setattr(run, "compute_chunk", made_up)
    monkeypatch.setattr(table, "WINDOW", 3000)
    sweep = large_sweep(20_000)
    stream_sweep(sweep, tmp_path)
    result = open_sweep(tmp_path)
    diameter = sweep.designs["piston_diameter"]
    ok = diameter < 0.011
    np.testing.assert_array_equal(result.frame["piston_diameter"], diameter)
    name = list(METRICS)[4]
    np.testing.assert_array_equal(result.frame[name], np.where(ok, diameter * 5, np.nan))
    assert (result.frame["status"] == np.where(ok, "ok", "stalled")).all()
    part = open_sweep(tmp_path, lambda names: ["mean_flow"])
    assert part.metrics == result.metrics and part.fields == result.fields
    assert [n for n in part.frame if n in METRICS] == ["mean_flow"]
    np.testing.assert_array_equal(part.frame["mean_flow"], result.frame["mean_flow"])
    assert len(list(sweep_parts(tmp_path))) >= 7
    assert summary_of_parts(sweep_parts(tmp_path)) == summary_of_parts([result])


def test_the_pareto_front_of_many_designs_is_that_of_all_pairs(monkeypatch):
    rng = np.random.default_rng(1)
    first, second = rng.random(60_000).round(3), rng.random(60_000).round(3)
    fast = pareto_front.non_dominated(first, second)
    monkeypatch.setattr(pareto_front, "FEW_DESIGNS", 10**9)
    np.testing.assert_array_equal(fast, pareto_front.non_dominated(first, second))
    # one that dominates all, and one line of which none dominates another
    assert list(pareto_front.non_dominated(np.append(first, 2.0), np.append(second, 2.0))) == [60_000]
    monkeypatch.undo()
    line = np.linspace(0.0, 1.0, 20_000)
    np.testing.assert_array_equal(pareto_front.non_dominated(line, 1.0 - line), np.arange(20_000))


def test_every_pixel_with_a_design_is_drawn():
    rng = np.random.default_rng(2)
    x, y = rng.normal(size=300_000), rng.normal(size=300_000)
    drawn = pareto_front._drawn(x, y)
    width, height = pareto_front.PIXELS

    def pixels(rows):
        ends = ((v - v.min()) / np.ptp(v) for v in (x, y))
        columns = (np.minimum((e * n).astype(int), n - 1)[rows] for e, n in zip(ends, (width, height), strict=True))
        return set(zip(*columns, strict=True))

    assert len(drawn) < 300_000 and pixels(drawn) == pixels(np.arange(300_000)) and len(pixels(drawn)) == len(drawn)
    np.testing.assert_array_equal(pareto_front._drawn(x[:50], y[:50]), np.arange(50))


def test_few_levels():
    values = np.resize([3.0, 1.0, 2.0], 10_000)
    np.testing.assert_array_equal(few_levels(values, 3), [1.0, 2.0, 3.0])
    assert few_levels(values, 2) is None and few_levels(np.arange(1e6), 12) is None
    assert few_levels(np.append(np.zeros(5000), np.arange(20.0)), 12) is None
