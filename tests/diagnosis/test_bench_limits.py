"""Deviations of the bench are held tighter while a model leaves much; solver errors on another branch do not count."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from edhas_jax.core import structs
from edhas_jax.diagnosis.report import bench_findings
from edhas_jax.diagnosis.report.bench_findings import bench_rows, excessive_deviations
from edhas_jax.inference.fit.evaluated_fit import _without_branches, fit_coarse, start_coordinates
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.settled_fit import MIN_TIGHT_RESIDUAL, with_tightened_bench
from edhas_jax.inference.likelihood.bench_deviations import (
    FILTER_CUTOFFS,
    Deviation,
    DeviationKind,
    bench_deviations,
    deviation_columns,
)
from edhas_jax.inference.likelihood.bench_estimate import EstimatedDeviation
from edhas_jax.machine.effects import InverterDeadTime
from edhas_jax.measurements.measurement_model import PredictedSignals
from edhas_jax.measurements.unknown_parameters import UnknownParameter
from tests.support.synthetic_campaign import PER_SAMPLE, bench, empty_campaign, measured

GUARDED = DeviationKind.SETTING, DeviationKind.GAIN, DeviationKind.OFFSET, DeviationKind.SHIFT


def fitted(campaign, steps=12):
    problem = calibration_problem(campaign)
    return fit_coarse(problem, start_coordinates(problem, {}), PER_SAMPLE, steps)


@pytest.fixture(scope="module")
def far():
    """A fit that lacks a large effect."""
    truth = structs.replace(bench(), effects=(*bench().effects, InverterDeadTime(dead_time_voltage=3.0)))
    return fitted(measured(empty_campaign(), truth))


def test_columns_are_as_much_smaller_as_the_bench_is_tightened(far):
    problem, run = far.fit.problem, far.fit.problem.model().runs[0]
    tight = dataclasses.replace(problem.campaign, tightening=4.0)
    for usual, held in zip(problem.bench.of_sensors, bench_deviations(tight, problem.unknowns).of_sensors, strict=True):
        one, other = (
            deviation_columns([d], run, "current", far.fit.outcomes[0], problem.unknowns) for d in (usual, held)
        )
        np.testing.assert_allclose(other, one / (4.0 if usual.kind in GUARDED else 1.0), rtol=1e-12)
        assert held.std == usual.std


SETTING = UnknownParameter("force_constant", 12.0, 0.02, "N/A", (1.0, 100.0))


def recorded(time, deviates=None, size=0.0):
    """What a recorder shows of a signal that grows with the square of a setting, where something deviates."""
    setting = SETTING.centre * np.exp(size if deviates is DeviationKind.SETTING else 0.0)
    late = {DeviationKind.TRIGGER: -size, DeviationKind.SHIFT: size}.get(deviates, 0.0)
    values = setting**2 * (2.0 + np.sin(60.0 * (time - late)))
    return {DeviationKind.GAIN: (1.0 + size) * values, DeviationKind.OFFSET: values + size}.get(deviates, values)


@pytest.mark.parametrize("kind", [DeviationKind.TRIGGER, *GUARDED])
def test_a_column_is_the_change_of_what_is_recorded(kind):
    """A sensor that is late by s shows at t what was at t − s; a record that begins late by τ, what is at t + τ."""
    run, size = empty_campaign().runs[0], 1e-5
    values = recorded(run.time)
    slopes = (2.0 * SETTING.spread * values)[:, None]  # by the coordinate of the setting
    deviation = Deviation(kind, SETTING.name if kind is DeviationKind.SETTING else "current", size)
    predicted = PredictedSignals({"current": values}, {"current": slopes})
    (column,) = deviation_columns([deviation], run, "current", predicted, (SETTING,)).T
    change = recorded(run.time, kind, size) - values
    np.testing.assert_allclose(column[1:-1], change[1:-1], atol=2e-3 * np.abs(change).max())


@pytest.mark.parametrize("cutoff", FILTER_CUTOFFS)
def test_a_filter_of_the_recorder_passes_what_is_constant_and_halves_the_power_at_its_cut_off(cutoff):
    run, weight = empty_campaign().runs[0], 0.1
    angle = 2.0 * np.pi * cutoff * np.arange(len(run.time))

    def filtered(values):
        predicted = PredictedSignals({"current": values}, {"current": np.zeros((len(values), 0))})
        deviation = Deviation(DeviationKind.FILTER, "", weight, cutoff)
        (column,) = deviation_columns([deviation], run, "current", predicted, ()).T
        return values + column / weight

    np.testing.assert_allclose(filtered(np.full(len(angle), 3.0)), 3.0, rtol=1e-9)  # from the first sample on
    later = angle[100:]
    basis = np.column_stack([np.ones(len(later)), np.cos(later), np.sin(later)])
    mean, cosine, sine = np.linalg.lstsq(basis, filtered(3.0 + np.cos(angle))[100:], rcond=None)[0]
    assert mean == pytest.approx(3.0) and np.hypot(cosine, sine) == pytest.approx(np.sqrt(0.5))
    assert sine > 0.5  # it comes later


def test_a_model_that_leaves_much_may_not_blame_the_bench(far):
    held = with_tightened_bench(far, PER_SAMPLE)
    factor = held.fit.problem.campaign.tightening
    assert factor > MIN_TIGHT_RESIDUAL and held.excess > far.excess
    before, after = (
        max(abs(row.value) for row in f.bench.deviations(f.fit.problem.bench) if row.deviation.kind in GUARDED)
        for f in (far, held)
    )
    assert after < 0.5 * before
    assert factor == pytest.approx(np.sqrt(2.0 * held.cost / held.samples), rel=0.3)


def test_a_good_model_keeps_the_accuracy_of_the_bench():
    near = fitted(measured(empty_campaign(), bench()))
    assert with_tightened_bench(near, PER_SAMPLE) is near


def test_a_solver_error_on_another_branch_is_left_out():
    """At one run the fine step leaves the measurements that the coarse one has followed; at the other it is nearer."""
    noise = {"current": SimpleNamespace(noise=0.1)}
    problem = SimpleNamespace(campaign=SimpleNamespace(channels=noise), solver_error=None)
    ones = np.ones(50)
    evaluated = SimpleNamespace(
        fit=SimpleNamespace(problem=problem), residuals={"near": {"current": ones}, "jumps": {"current": ones}}
    )
    error = {"near": {"current": 0.05 * ones}, "jumps": {"current": 0.7 * ones}}
    assert set(_without_branches(evaluated, error)) == {"near"}


def row(kind, value, std, run="", name="", accuracy=1.0):
    return EstimatedDeviation(Deviation(kind, name, accuracy), run, value, std)


@pytest.mark.parametrize(
    ("kind", "size", "is_possible"),
    [
        (DeviationKind.FILTER, 0.8, True), (DeviationKind.FILTER, 370.0, False), (DeviationKind.FILTER, -2.0, False),
        (DeviationKind.SETTING, -0.2, True), (DeviationKind.SETTING, 0.9, False), (DeviationKind.GAIN, -1.4, False),
        (DeviationKind.OFFSET, 40.0, True), (DeviationKind.TRIGGER, 3e-4, True),
    ],
)  # fmt: skip
def test_a_bench_does_not_deviate_beyond_its_linear_columns(kind, size, is_possible):
    assert row(kind, size / 5e-3, 1.0, accuracy=5e-3).is_possible is is_possible
    assert row(kind, size / 5e-3, 1e3 * abs(size), accuracy=5e-3).is_possible, "within its error it may be nothing"


def test_each_deviation_has_one_row():
    trigger, filtered = DeviationKind.TRIGGER, DeviationKind.FILTER
    rows = [
        row(filtered, 4.8, 0.3), row(filtered, 3.3, 0.4), row(filtered, -2.4, 1.2), row(trigger, 2.0, 0.1, "a"),
        row(trigger, 1.0, 0.2, "b, first part"), row(trigger, 2.0, 0.2, "b, last part"),
    ]  # fmt: skip
    found = {(r.deviation.kind, r.run): (r.value, r.std) for r in bench_findings._of_records(rows)}
    assert found[filtered, ""] == pytest.approx((5.7, 1.3))
    assert found[trigger, "a"] == pytest.approx((2.0, 0.1))
    assert found[trigger, "b"] == pytest.approx((1.5, 0.5)), "its parts contradict each other"


def test_what_no_bench_does_is_said_in_one_sentence_and_not_listed(monkeypatch):
    rows = [row(DeviationKind.FILTER, 5.7, 1.3), row(DeviationKind.TRIGGER, 4.0, 0.1, "run1", accuracy=2e-4)]
    monkeypatch.setattr(bench_findings, "clear_deviations", lambda evaluated: rows)
    evaluated = SimpleNamespace(fit=SimpleNamespace(problem=SimpleNamespace(machine=bench())))
    assert [what for what, *_ in bench_rows(evaluated)] == ["trigger"]
    impossible, excessive = excessive_deviations(evaluated)
    assert impossible.startswith("Part of what the model leaves")
    assert "filter of the recorder (+570 %)" in impossible
    assert excessive.startswith("trigger of run1: 800")
