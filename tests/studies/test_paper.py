"""The studies of the paper in short form: what is read, fitted and determined, and what a refinement buys."""


import numpy as np
import pytest

from edhas_jax.core import structs
from studies.paper import calibration, configs, questions, refinements
from studies.paper import published_numbers as numbers
from studies.paper import readings as reading
from studies.paper import reproduction as paper
from studies.paper import table as paper_table
from tests.support.headline import headline, quoted_headline


@pytest.fixture(scope="module")
def nominal():
    return configs.machines(paper.NOMINAL_CONFIGS)


@pytest.fixture(scope="module")
def shipped():
    """Where the shipped configuration stands in the ranges, 0 … 1."""
    chosen = configs.quantities_of(configs.machines(configs.NAMES)[0])
    return np.log(np.array([chosen[n] for n in calibration.NAMES]) / calibration.LOW) / calibration.SPAN


def test_a_peak_between_samples_is_found():
    for late in (0.0, 3.3, 100.25):
        phase = 2.0 * np.pi * (np.arange(reading.SAMPLES) - late) / reading.SAMPLES
        place, height = reading.peak(2.0 * np.cos(phase))
        assert float(place) % reading.SAMPLES == pytest.approx(late, abs=1e-3)
        assert float(height) == pytest.approx(2.0, rel=1e-9)


def test_settling_is_where_an_exponential_enters_the_band():
    t = np.arange(2001) / reading.STEP_RATE
    assert reading.settling_time(1.0 - np.exp(-t / 0.1), 1.0, 0.02) == pytest.approx(0.1 * np.log(50.0), abs=1e-4)
    assert np.isnan(reading.settling_time(0.5 * t, 1.0, 0.02))


def test_quantities_left_open_are_complete_and_physical():
    for o in numbers.OPEN_QUANTITIES:
        assert 0.0 < o.low < o.high
    table = numbers.with_derived_parameters({"valve_seat_diameter": 8e-3, "valve_opening_pressure": 1e4})
    assert table["valve_mass"] == pytest.approx(7850.0 * np.pi / 6.0 * 0.01**3)  # a steel ball of 10 mm
    assert table["valve_preload"] == pytest.approx(1e4 * np.pi / 4.0 * 8e-3**2)


def test_derivatives_of_the_calibration_are_those_of_finite_differences(nominal):
    x, direction, h = np.array([0.6, 0.3, 0.4, 0.8, 0.2, 0.5]), np.array([1.0, -0.7, 0.2, 0.8, -0.6, 0.9]), 2e-3
    _, slopes = calibration.residuals(nominal[0], x)
    up, down = (calibration.residuals(nominal[0], x + sign * h * direction)[0] for sign in (1.0, -1.0))
    found, expected = slopes @ direction, (up - down) / (2.0 * h)
    # smooth to what a valve that meets its seat within a step leaves of it
    assert np.all(np.abs(found - expected) <= 0.03 * np.linalg.norm(slopes, axis=1))


def test_the_shipped_machine_is_the_least_squares_one(nominal, shipped):
    """No step inside the ranges lowers the sum of squares by more than the rounding to four digits leaves."""
    assert np.all((shipped > -1e-3) & (shipped < 1.0 + 1e-3))
    r, j = calibration.residuals(nominal[0], shipped)
    inside = (shipped > 1e-3) & (shipped < 1.0 - 1e-3)
    step = np.linalg.lstsq(j[:, inside], -r, rcond=None)[0]
    gained = r @ r - np.sum((r + j[:, inside] @ step) ** 2)
    assert gained < 0.05
    for k, at in enumerate(shipped):
        if not inside[k]:  # held back by the end of its range: it would go on
            assert (j[:, k] @ r) * (1.0 if at < 0.5 else -1.0) > 0.0


def test_calibrated_configurations_are_written_and_read_back(nominal, tmp_path):
    chosen = configs.quantities_of(configs.machines(configs.NAMES)[0])
    configs.write_configs(*nominal, chosen, tmp_path)
    for name in configs.NAMES:
        assert (tmp_path / f"{name}.yaml").read_text() == (configs.CONFIGS / f"{name}.yaml").read_text()


def test_the_table(tmp_path, monkeypatch, capsys):
    few = (10.0, 20.0, 26.0, 30.0, 34.0, 60.0)
    monkeypatch.setattr(paper, "FREQUENCIES", few)
    monkeypatch.setattr(paper_table, "COARSE_FREQUENCIES", few)
    found = paper.main(["--draws", "8", "--out", str(tmp_path)])
    printed = headline(capsys)
    assert {n: float(printed[n]) for n in ("worst_error", "worst_fitted")} == pytest.approx(
        {n: found[n] for n in ("worst_error", "worst_fitted")}, abs=1e-4
    )
    assert found["worst_error"] < 0.05  # the paper's simulation where its parameters determine a figure
    assert found["worst_fitted"] < 0.05
    assert found["leak_mean"] < 0.005 and abs(found["steady"]) < 0.103
    pictures = sorted(tmp_path.glob("*.png"))
    assert len(pictures) == 6 and all(p.stat().st_size < 200_000 for p in pictures)


def test_a_term_is_taken_out_by_its_numbers(nominal):
    """The ideal machine by numbers is the machine without the effects."""
    names, table = refinements.variants(nominal[1])
    ideal = {n: v[:1] for n, v in table.items()}
    valve = {n: v for n, v in ideal.items() if n.startswith("valve")}
    by_numbers = refinements.quantities(*nominal, ideal)
    bare = [structs.replace(machine, effects=()) for machine in nominal]
    without = reading.figures_at_10_hz(bare[0], valve) | reading.step_figures(bare[1], valve)
    without["flow"] = reading.mean_flows(bare[0], valve, (30.0,))[0]
    assert names[0] == "ideal"
    for value, name in zip(by_numbers[:, 0], refinements.QUANTITIES, strict=True):
        assert value == pytest.approx(without[name][0], rel=1e-3), name


def test_valves_cost_flow_and_friction_does_not(tmp_path, capsys):
    found = refinements.main(["--out", str(tmp_path)])
    printed = headline(capsys)
    assert set(found) < set(printed)
    assert printed == quoted_headline("docs/paper.md", "python -m studies.paper.refinements")
    assert found["ideal_flow_error"] > 5.0 > found["friction_takes"]
    assert found["valves_take"] > 10.0 * abs(found["friction_takes"])
    assert found["friction_needed_n"] > 3.0 * refinements.LARGEST_PUBLISHED_FRICTION
    assert (tmp_path / "refinements.png").stat().st_size < 200_000


def test_answers_to_the_questions_are_those_of_the_page(capsys):
    questions.main([])
    assert headline(capsys) == quoted_headline("docs/paper.md", "python -m studies.paper.questions")
