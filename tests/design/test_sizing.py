"""Sizing: derivatives, comparison with a sweep of the same space, constraints, invalid input, the command."""

from types import SimpleNamespace

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import ConfigError, read_config
from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import sobol_sequence
from edhas_jax.design.sizing.config import RobustObjective, load_sizing
from edhas_jax.design.sizing.optimiser import FEASIBILITY_TOLERANCE
from edhas_jax.design.sizing.problem import SizingProblem
from edhas_jax.design.sizing.size import SizingError, size
from tests.support.reference import DATA

CONFIG = f"""
name: small
base: {DATA.parent.parent / "configs" / "paper.yaml"}
parameters: {{load_orifice_area: 1 mm²}}
points: {{frequency: [10 Hz, 25 Hz]}}
free:
  piston_diameter: {{from: 8 mm, to: 14 mm}}
  valve_spring_rate: {{from: 50 N/m, to: 1 kN/m, spacing: log}}
objective:
  maximise: {{mean_flow: 1, overall_efficiency: 1}}
constraints:
  rms_current: {{max: 4 A}}
  peak_stroke: {{max: 4.5 mm}}
starts: 4
iterations: 6
batch: {{step: 50 us, tolerance: 0.1 %}}
"""
ROBUST = """robust:
  judge: worst_case
  tolerances:
    piston_clearance: {plus_minus: 3 um}
    valve_spring_rate: {plus_minus: 5 %}
    oil_viscosity: {from: 0.02 Pa·s, to: 0.08 Pa·s}
"""


def written(folder, *changes):
    text = CONFIG
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "size.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    task = load_sizing(written(tmp_path_factory.mktemp("sizing")))
    return task, size(task)


def test_at_least_as_good_as_a_sweep(result):
    """The sweep covers the same space with the same goals and constraints."""
    task, found = result
    designs, frequency = sobol_sequence(task.variables, 400), task.operating_points()["frequency"]
    table = {n: np.repeat(v, len(frequency)) for n, v in designs.items()}
    got = run_designs(task.machine, table | {"frequency": np.tile(frequency, 400)}, task.settings)
    got = {n: v.reshape(400, -1) for n, v in got.items()}
    allowed = (got["status"] == 0).all(axis=1) & (got["peak_voltage"] < 48.0).all(axis=1)
    for constraint in task.constraints:
        allowed &= (got[constraint.metric] <= constraint.value * (1 + FEASIBILITY_TOLERANCE)).all(axis=1)
    objective = np.log(got["mean_flow"] * got["overall_efficiency"]).mean(axis=1)
    assert 10 < allowed.sum() < 400
    assert found.machines[0].objective >= objective[allowed].max() - 1e-3
    assert found.machines[0].violation <= FEASIBILITY_TOLERANCE
    assert any("rms_current" in text for text in found.machines[0].active)
    assert found.share_near_best >= 0.5 and found.machine_seconds > 0.0


def test_the_path_contains_all_starts(result):
    _, found = result
    assert set(found.path["start"]) == {0, 1, 2, 3}
    best = found.path[found.path["violation"] <= FEASIBILITY_TOLERANCE]["objective"].max()
    assert found.machines[0].objective >= best - 0.02
    assert found.machines[0].objective > found.start.objective or found.start.violation > FEASIBILITY_TOLERANCE


@pytest.mark.parametrize("more", ["", ROBUST, ROBUST.replace("worst_case", "expected")])
def test_gradients_of_objective_and_constraints_match_finite_differences(tmp_path, more):
    task = load_sizing(written(tmp_path, ("starts: 4\n", "starts: 4\n" + more)))
    problem = SizingProblem(task, 8192)
    z, d = np.array([0.45, 0.55]), 0.01
    evaluation = problem.evaluate(z[None])
    moved = problem.evaluate(np.array([z + d * e for e in (*np.eye(2), *-np.eye(2))]))
    pairs = (
        (moved.objective, evaluation.gradient[0]), (moved.constraints, evaluation.constraint_gradients[0].T)
    )  # fmt: skip
    for value, gradient in pairs:
        differences = (value[:2] - value[2:]) / (2 * d)
        np.testing.assert_allclose(gradient, differences, atol=0.03 * np.abs(differences).max() + 1e-3)


def test_the_worst_case_is_below_the_expected_value(tmp_path):
    texts = {kind: ROBUST.replace("worst_case", kind) for kind in ("worst_case", "expected")}
    objective = {}
    for kind, text in texts.items():
        task = load_sizing(written(tmp_path, ("starts: 4\n", "starts: 4\n" + text)))
        problem = SizingProblem(task, 1024)
        assert len(problem.cases) == 2 * 9
        objective[kind] = problem.evaluate(problem.initial_fractions()[None]).objective[0]
    assert objective["worst_case"] < objective["expected"]


@pytest.mark.parametrize("kind", list(RobustObjective))
def test_goals_of_nearly_equal_corners_have_the_slopes_of_finite_differences(kind):
    """The worst case passes from one corner to another there: metrics exp(a + b z), two points with three corners."""
    a = np.log(5.0) + np.array([0.0, 0.012, 0.02, 1.0, 1.0, 1.004])
    b = np.array([0.5, -0.2, 0.9, 0.3, -0.6, 0.1])
    weights = {"mean_flow": 1.0, "mean_electrical_power": -0.5}
    problem = SimpleNamespace(task=SimpleNamespace(weights=weights, robust=kind), corners=[None, 0, 1])

    def goals_at(z):
        values = np.exp(a + b * z)[None]
        slopes = (b * values)[:, :, None]
        return SizingProblem._goals(problem, dict.fromkeys(weights, values), dict.fromkeys(weights, slopes))

    goals, slopes = goals_at(0.0)
    difference = (goals_at(1e-5)[0] - goals_at(-1e-5)[0]) / 2e-5
    np.testing.assert_allclose(slopes[0, :, 0], difference[0], rtol=1e-6)
    corners = a.reshape(2, 3)
    worst = corners.min(axis=1).mean(), corners.max(axis=1).mean()  # of what is to be large, and of what is to be small
    if kind is RobustObjective.WORST_CASE:
        np.testing.assert_allclose(goals[0], worst, atol=0.01)
        assert worst[0] <= goals[0, 0] < corners.mean() < goals[0, 1] <= worst[1]
    else:
        np.testing.assert_allclose(goals[0], corners.mean(), rtol=1e-12)


def test_a_design_that_runs_onto_its_stops_says_so():
    """The stops are 5 mm from the middle: half of the pump stroke of 10 mm."""
    points, free = {"frequency": ["5 Hz", "10 Hz"]}, {"amplitude": ("3 mm", "8 mm")}
    found = edhas.size(
        edhas.ActuatorBench(), free=free, maximise=["peak_stroke"], points=points, starts=1, iterations=5
    )
    assert found.best.design["amplitude"] > found.task.machine.stops.pump_stroke / 2
    assert found.best.warnings == ("hit_stops in 2 of 2 cases: the piston ran onto an end stop",)
    assert "ran onto an end stop" in str(found.summary()) and not found.start.warnings


def test_a_pareto_front_is_monotonic(tmp_path):
    found = size(load_sizing(written(tmp_path, ("starts: 4", "front: 3\nstarts: 2"))))
    flow, efficiency = (
        np.array([sized.metrics[m].mean() for sized in found.machines]) for m in ("mean_flow", "overall_efficiency")
    )
    assert (np.diff(flow) < 0).all() and (np.diff(efficiency) > 0).all()


def test_the_command_writes_a_configuration_that_runs(tmp_path, capsys):
    config = written(tmp_path, ("starts: 4", "starts: 1"))
    assert main(["size", str(config), "--out", str(tmp_path / "out")]) == 0
    assert "limited by" in capsys.readouterr().out
    sized = read_config(tmp_path / "out" / "sized.yaml")
    result = edhas.open_result(tmp_path / "out")
    saved, path = result.numbers, result.table("path")
    assert sized.machine.pump.piston_diameter == pytest.approx(saved["machines"][0]["design"]["piston_diameter"])
    assert len(path) and (tmp_path / "out" / "path.png").stat().st_size > 10_000
    assert main(["simulate", str(tmp_path / "out" / "sized.yaml"), "--set", "duration=0.25 s", "--no-figure",
                 "--out", str(tmp_path / "run")]) == 0  # fmt: skip


@pytest.mark.parametrize(("old", "new", "message"), [
    ("{max: 4 A}", "{max: 0.1 A}", "cannot be met together: rms_current ≤ 0.1 A.*nearest design"),
    ("rms_current: {max: 4 A}", "overall_efficiency: {min: 99.5 %}", "overall_efficiency ≥ 99.5 % .[0-9.]+ %"),
    ("mean_flow: 1, overall_efficiency: 1", "peak_voltage: 1", None),
])  # fmt: skip
def test_an_unsolvable_task_is_refused(tmp_path, old, new, message):
    changes = [(old, new), ("starts: 4", "starts: 1")]
    if message is None:  # the relief valve opens at 6 MPa, far above this pump
        changes += [("piston_diameter: {from: 8 mm, to: 14 mm}", "relief_pressure: {from: 5.8 MPa, to: 6.5 MPa}"),
                    ("valve_spring_rate: {from: 50 N/m, to: 1 kN/m, spacing: log}",
                     "relief_conductance: {from: 0.5e-10 m^3/(s·Pa), to: 2e-10 m^3/(s·Pa)}"),
                    ("rms_current: {max: 4 A}", "rms_current: {max: 40 A}")]  # fmt: skip
        message = "objective.peak_voltage: does not depend on any free dimension"
    with pytest.raises(SizingError, match=message):
        size(load_sizing(written(tmp_path, *changes)))


@pytest.mark.parametrize(("old", "new", "message"), [
    ("piston_diameter: {from: 8 mm, to: 14 mm}", "coulomb_friction: {from: 2 N, to: 8 N}",
     ":7: free.coulomb_friction: static_friction must be at least coulomb_friction, but may become 6 N with "),
    ("from: 8 mm, to: 14 mm", "from: 13 mm, to: 14 mm", ":7: free.piston_diameter: the range 13 mm … 14 mm excludes"),
    ("mean_flow: 1", "mean_flw: 1", ":10: objective.maximise.mean_flw: no metric `mean_flw`.*mean_flow"),
    ("rms_current: {max: 4 A}", "rms_current: {max: 4 V}", ":12: constraints.rms_current.max: .*not a current"),
    ("rms_current: {max: 4 A}", "rms_current: {max: 4 A, min: 5 A}", ":12: constraints.rms_current: `min` lies above"),
    ("rms_current: {max: 4 A}", "rms_current: 4 A", ":12: constraints.rms_current: `max:` or `min:`"),
    ("starts: 4", "starts: none", ":14: starts: a whole number"),
    ("starts: 4", "front: 4\nobjectives: 3", ":15: objectives: unknown key"),
])  # fmt: skip
def test_an_invalid_configuration_is_refused(tmp_path, old, new, message):
    with pytest.raises(ConfigError, match=message):
        load_sizing(written(tmp_path, (old, new)))


TANK = """
from edhas_jax import Rig, drive, par, state

class Tank(Rig):
    area: float = par(2.0, "m^2", (0.1, 100.0), "area")
    inflow = drive("m^3/s", "inflow", 1e-3)
    level = state("m", "level")

    def equations(self, y, s):
        return {"level": (s.inflow - 1e-3 * y.level) / self.area}
"""


def test_a_list_as_range_is_the_only_problem_that_is_told(tmp_path):
    (tmp_path / "tank.py").write_text(TANK, encoding="utf-8")
    task = {"machine": {"rig": f"{tmp_path / 'tank.py'}:Tank"}, "free": {"area": ["1 m^2", "2 m^2"]},
            "objective": {"minimise": ["largest_level"]}}  # fmt: skip
    with pytest.raises(ConfigError) as caught:
        load_sizing(task, trust=[tmp_path / "tank.py"])
    assert str(caught.value) == "free.area: a range {from: …, to: …} belongs here, not a list"


def test_a_rig_that_may_not_run_is_the_only_problem_that_is_told(tmp_path):
    (tmp_path / "tank.py").write_text(TANK + "# not allowed", encoding="utf-8")
    machine = {"rig": f"{tmp_path / 'tank.py'}:Tank", "inflow": "1 L/s"}
    with pytest.raises(ConfigError) as caught:
        load_sizing({"machine": machine, "free": {"area": {"from": "1 m^2", "to": "2 m^2"}},
                     "objective": {"minimise": ["largest_level"]}})  # fmt: skip
    assert "was not allowed to run" in str(caught.value) and "unknown key" not in str(caught.value)
    assert "no metric" not in str(caught.value)


def test_an_interrupted_search_returns_its_best_design(tmp_path, monkeypatch):
    evaluate, calls = SizingProblem.evaluate, []

    def interrupted(self, fractions, weights=None):
        calls.append(len(fractions))
        if len(calls) == 6:
            raise KeyboardInterrupt
        return evaluate(self, fractions, weights)

    monkeypatch.setattr(SizingProblem, "evaluate", interrupted)
    found = size(load_sizing(written(tmp_path, ("starts: 4", "starts: 2"))))
    assert "interrupted" in found.machines[0].convergence and set(found.path["iteration"]) == {0, 1, 2}


def test_a_design_that_is_not_valid_is_not_searched(tmp_path):
    """Above the relief pressure the efficiency of the model is 3800 %."""
    old = "  piston_diameter: {from: 8 mm, to: 14 mm}\n  valve_spring_rate: {from: 50 N/m, to: 1 kN/m, spacing: log}\n"
    new = "  accumulator_pressure: {from: 0.1 MPa, to: 20 MPa}\n"
    task = load_sizing(written(tmp_path, (old, new), ("[10 Hz, 25 Hz]", "[10 Hz]")))
    evaluation = SizingProblem(task, 512).evaluate(np.array([[0.005], [1.0]]))
    assert np.isfinite(evaluation.objective[0]) and np.isnan(evaluation.objective[1])
    assert evaluation.violation[1] == np.inf
