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
    Deviation,
    DeviationKind,
    bench_deviations,
    deviation_columns,
)
from edhas_jax.inference.likelihood.bench_estimate import EstimatedDeviation
from edhas_jax.machine.effects import InverterDeadTime
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
