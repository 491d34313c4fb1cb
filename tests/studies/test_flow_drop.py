"""The causes of the fall of flow in short form: what is scanned, read, told apart and diagnosed."""

import math

import numpy as np
import pytest

from edhas_jax.diagnosis.search.result import Verdict
from edhas_jax.machine.effects import SuctionLineResistance
from edhas_jax.machine.parameters import list_parameters
from studies.flow_drop import cause_analysis, causes, diagnosis
from studies.flow_drop import discrimination as parting
from tests.support.headline import headline

SIZES = {"late valves": 169.0, "narrow suction line": 1.115e9}
FEW = (parting.Run(10.0, 3.5e-3), parting.Run(38.0, 3.5e-3))


def cause(title):
    return next(c for c in causes.CAUSES if c.title == title)


@pytest.fixture(scope="module")
def base():
    return causes.base_machine()


@pytest.fixture(scope="module")
def rivals(base):
    return [causes.Sized(cause(title), size, math.nan, math.nan, math.nan, math.nan) for title, size in SIZES.items()]


@pytest.fixture(scope="module")
def suspects(base, rivals):
    return [parting.Suspected(base, s) for s in rivals]


def test_nothing_falls_in_the_machine_without_a_cause(base):
    flow = causes.mean_flows(base, {"valve_mass": np.array([1e-3])}, (10.0, 20.0, 30.0, 45.0, 60.0))[:, 0]
    assert np.all(np.diff(flow) > 0.0) and flow[1] > 0.98 * 2.0 * flow[0]


def test_causes_are_within_what_the_machine_allows(base):
    for c in causes.CAUSES:
        span = next(p.span for p, _, _ in list_parameters(c.machine(base)) if p.name == c.name)
        for size in (*c.plausible, c.furthest):
            assert span[0] <= size <= span[1], c.title
        assert c.believable(c.plausible[0]) and not c.believable(c.furthest)


@pytest.mark.parametrize("title", SIZES)
def test_late_valves_and_a_narrow_line_make_the_flow_fall(base, title):
    (s,) = causes.sizes_of(base, cause(title), rounds=1)
    assert s.guilty and s.between[0] <= s.size <= s.between[1]
    assert s.size == pytest.approx(SIZES[title], rel=0.3)


def test_warm_oil_does_not(base):
    c = cause("warm oil")
    flow = causes.flow_of(base, c, c.plausible, (20.0, 30.0, 45.0))
    assert np.all(np.diff(flow, axis=0) > 0.0)
    np.testing.assert_allclose(flow[:, 0], flow[:, 1], rtol=0.01)


def test_the_top_of_a_parabola_is_the_knee():
    f = np.array([10.0, 20.0, 27.0, 36.0, 50.0])
    assert causes.knee_of(f, 5.0 - (f - 29.0) ** 2) == pytest.approx(29.0)
    assert math.isnan(causes.knee_of(f, f))


def test_slopes_are_those_of_finite_differences(suspects):
    line = suspects[1]
    h, at = 1e-3, np.zeros((2, len(line.unknowns)))
    at[:, 0] = h, -h
    moved, slopes = line.read(at, FEW[:1], derive=False).values, line.as_sized(FEW[:1], derive=True).slopes
    for name in parting.READINGS:
        expected = (moved[name][0] - moved[name][1]) / (2.0 * h)
        found = slopes[name][0, ..., 0]
        assert np.linalg.norm(found - expected) < 0.02 * np.linalg.norm(expected), name


def test_what_is_left_is_the_least_squares():
    rng = np.random.default_rng(3)
    r, j, x = rng.standard_normal(20), rng.standard_normal((20, 4)), rng.standard_normal(4)
    covariance = np.eye(20) + j @ j.T
    expected = (r - j @ x) @ np.linalg.solve(covariance, r - j @ x)
    assert parting._left(r, j, x) == pytest.approx(math.sqrt(expected))


def test_the_flow_parts_less_than_the_flow_and_a_pressure(suspects):
    found = parting.part(suspects, FEW)
    (alone,), (with_pressure,) = (found.pairs(n).values() for n in (parting.MEAN_FLOW, "chamber_pressure_a"))
    assert alone <= with_pressure and with_pressure > parting.CLEAR
    assert all(np.isnan(d[[0, 0, 1], [0, 1, 1]]).all() for d in found.distances.values())


def test_valves_may_be_late_in_every_model(suspects):
    late, line = suspects
    assert parting._apart(line, late) and not parting._apart(late, line) and not parting._apart(line, line)


def test_the_piston_does_not_settle_it_and_the_chamber_does(suspects):
    every = parting.settling(suspects, FEW[1:])
    best = {s.reading: s.distance for s in every}
    assert every[0].distance == max(best.values())
    assert best["chamber_pressure_a"] > parting.CLEAR > best["piston_position"]


def test_a_narrow_line_hides_in_the_damping_at_10_hz(base, rivals, monkeypatch):
    """R A² of the line is a damping of the plungers: nothing seems to be missing, and the flow is foretold wrongly."""
    monkeypatch.setattr(diagnosis, "LIBRARY", (SuctionLineResistance,))
    stage = diagnosis.Stage("10 Hz", diagnosis.TEN_HZ[::3], diagnosis.AS_THE_PAPER)
    answer = diagnosis.ask(base, rivals[1], stage)
    assert answer.diagnosis.verdict is Verdict.ADEQUATE
    assert answer.damping[0] > 1.2 * answer.damping[1]
    assert answer.flow[0] > 1.3 * answer.flow[1]


def test_the_table_of_causes_says_which_of_them_make_the_flow_fall():
    """A row for each size, with its verdict from the limits of the study and whether its size is in the range."""
    line, late, warm, supply = (
        cause(title) for title in ("narrow suction line", "late valves", "warm oil", "low supply voltage")
    )
    found = [
        [causes.Sized(line, 1.1e9, 30.0, 0.98, 0.7, 0.5, (1e9, 1.3e9)), causes.Sized(line, 9e9, 28.0, 0.96, 0.4, 0.3)],
        [causes.Sized(late, 169.0, 31.0, 0.94, 0.8, 0.6)],
        [causes.Sized(warm, 0.006, math.nan, 1.0, 1.0, 1.0)],
        [causes.Sized(supply, 30.0, 29.0, 0.97, 0.9, 0.97)],
    ]
    table = cause_analysis.cause_table(found)
    columns = {str(column.header).split(",")[0]: list(column.cells) for column in table.columns}
    assert columns["cause"] == ["narrow suction line", "", "late valves", "warm oil", "low supply voltage"]
    assert columns["top"] == ["30", "28", "31", "none", "29"]
    assert columns["falls for"] == ["1e+09 … 1.3e+09", "", "", "", ""]
    verdicts = ["falls", "falls,\nbeyond range", "does not fall", "does not fall", "bends,\nbeyond range"]
    assert columns[""] == verdicts


def test_the_last_line_sums_up_what_is_told_apart(capsys):
    sizes = [causes.Sized(cause(title), size, 30.0, 0.98, 0.7, 0.5) for title, size in SIZES.items()]
    titles = tuple(SIZES)

    def distances(**by_reading):
        matrices = {n: np.array([[np.nan, d], [np.nan, np.nan]]) for n, d in by_reading.items()}
        return parting.Parting(titles, dict.fromkeys(parting.READINGS, np.full((2, 2), 0.1)) | matrices)

    partings = {
        "far": distances(**{parting.MEAN_FLOW: 1.2 * parting.CLEAR}),
        "near": distances(**{parting.MEAN_FLOW: 0.8 * parting.CLEAR, "outlet_pressure": 3.0 * parting.CLEAR}),
    }
    best = parting.Settling(parting.Run(35.0, 2.5e-3), "chamber_pressure_a", 12.34)
    returned = cause_analysis.last_line(sizes, partings, best)
    assert headline(capsys) == {name: str(value) for name, value in returned.items()} == {
        "causes_that_fall": "2", "parted_by_flow_to_45_hz": "1/1", "parted_by_flow": "0/1",
        "parted_with_piston": "0/1", "parted_with_pressure": "1/1",
        "settled_by": "chamber_pressure_a@35Hz_2.5mm", "settled_at_sigma": "12.3",
    }  # fmt: skip
