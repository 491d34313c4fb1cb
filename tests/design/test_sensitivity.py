"""Sobol indices against an analytic function and against SALib, Morris on functions with known effects, the command."""

import numpy as np
import pytest
from SALib.analyze import sobol as salib

import edhas_jax as edhas
from edhas_jax.commands.cli import main
from edhas_jax.config.machine_config import ConfigError
from edhas_jax.design.batch.batch import run_designs
from edhas_jax.design.batch.experiment_design import designs_at
from edhas_jax.design.sensitivity.config import load_sensitivity
from edhas_jax.design.sensitivity.global_sensitivity import (
    morris_effects,
    saltelli_sample,
    sobol_indices,
    sobol_indices_of,
)

CONFIG = """
name: small
base: {base}
points: {{frequency: [10 Hz, 30 Hz]}}
metrics: [mean_flow, mean_electrical_power]
local: [piston_diameter, valve_mass]
ranges:
  piston_diameter: {{from: 11 mm, to: 13 mm}}
  amplitude: {{from: 3 mm, to: 4 mm}}
  valve_spring_rate: {{from: 75 N/m, to: 300 N/m, spacing: log}}
samples: 32
trajectories: 4
batch: {{step: 50 us, tolerance: 1 %}}
"""


def ishigami(fractions):
    x = np.pi * (2.0 * fractions - 1.0)
    return (np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0]))[:, None]


def test_indices_of_the_ishigami_function():
    """The analytic indices lie in the confidence intervals and near the estimates."""
    found = sobol_indices(ishigami, ["x1", "x2", "x3"], ["y"], 4096, seed=0)
    v1, v2, v13 = 0.5 * (1 + 0.1 * np.pi**4 / 5) ** 2, 49.0 / 8, 0.01 * np.pi**8 * (1 / 18 - 1 / 50)
    first, total = np.array([v1, v2, 0.0]), np.array([v1 + v13, v2, v13])
    np.testing.assert_allclose(found["first"], first / (v1 + v2 + v13), atol=0.02)
    np.testing.assert_allclose(found["total"], total / (v1 + v2 + v13), atol=0.02)
    for column, right in (("first", first), ("total", total)):
        right = right / (v1 + v2 + v13)
        assert ((found[f"{column}_low"] - 0.01 < right) & (right < found[f"{column}_high"] + 0.01)).all()


def test_rows_with_failed_designs_are_discarded():
    def partly_failing(fractions):
        return np.where(fractions[:, :1] < 0.02, np.nan, ishigami(fractions))

    found = sobol_indices(partly_failing, ["x1", "x2", "x3"], ["y"], 256, seed=0)
    assert set(found["rows"]) == {128} and np.isfinite(found["total"]).all()
    with pytest.raises(ValueError, match="narrow the ranges"):
        sobol_indices(lambda fractions: np.full((len(fractions), 1), np.nan), ["x1"], ["y"], 64, seed=0)


@pytest.fixture(scope="module")
def task(tmp_path_factory):
    from tests.support.reference import DATA

    path = tmp_path_factory.mktemp("sensitivity") / "small.yaml"
    path.write_text(CONFIG.format(base=DATA.parent.parent / "configs" / "paper.yaml"), encoding="utf-8")
    return path


def test_indices_of_a_machine_match_salib_on_the_same_sample(task):
    task = load_sensitivity(task)
    names, n = [axis.name for axis in task.ranges], 64
    a, b, mixed = saltelli_sample(len(names), n, 0)
    got = run_designs(task.machine, designs_at(task.ranges, np.concatenate([a, b, *mixed])), task.settings)
    values = got["mean_flow"]
    ours = sobol_indices_of(values[:, None], names, ["mean_flow"], n, 0)
    parts = values.reshape(len(names) + 2, n)
    # SALib takes A, the mixed designs and B of each row together
    order = np.concatenate([parts[:1], parts[2:], parts[1:2]]).T.ravel()
    theirs = salib.analyze({"num_vars": len(names), "names": names, "bounds": [[0, 1]] * len(names)}, order,
                           calc_second_order=False, seed=0)  # fmt: skip
    np.testing.assert_allclose(ours["first"], theirs["S1"], atol=0.02)
    np.testing.assert_allclose(ours["total"], theirs["ST"], atol=0.02)


def test_morris_effects_of_a_linear_and_a_quadratic_parameter():
    found = morris_effects(lambda s: (2.0 + s[:, 0] + 3.0 * s[:, 1] ** 2)[:, None], ["a", "b", "c"], ["y"], 20, seed=0)
    mu, sigma = found["mu_star"].to_numpy(), found["sigma"].to_numpy()
    assert mu[2] == 0.0 and mu[1] > 2.0 * mu[0]
    assert sigma[0] == pytest.approx(0.0, abs=1e-12) and sigma[1] > 0.05


def test_the_command(task, tmp_path, capsys):
    assert main(["sensitivity", str(task), "--out", str(tmp_path / "out")]) == 0
    assert "piston_diameter" in capsys.readouterr().out
    result = edhas.open_result(tmp_path / "out")
    points, local, sobol, morris = map(result.table, ("points", "local", "sobol", "morris"))
    assert len(points) == 2 and len(local) == 2 * 2 * 2
    assert set(sobol["point"]) == set(morris["point"]) == {0, 1}
    # a positive displacement pump: flow grows with the square of the diameter
    flow = local[(local["metric"] == "mean_flow") & (local["point"] == 0)]
    assert flow.set_index("parameter")["elasticity"]["piston_diameter"] == pytest.approx(2.0, abs=0.03)
    for picture in ("local.png", "sobol.png", "morris.png"):
        assert (tmp_path / "out" / picture).stat().st_size > 10_000


def test_without_ranges_only_elasticities_are_computed(task, tmp_path):
    text = task.read_text(encoding="utf-8")
    path = tmp_path / "local.yaml"
    path.write_text(text[: text.index("ranges:")], encoding="utf-8")
    found = load_sensitivity(path)
    assert found.samples == found.trajectories == 0 and found.local == ("piston_diameter", "valve_mass")


@pytest.mark.parametrize(("old", "new", "says"), [
    ("samples: 32", "samples: 30", r":11: samples: a power of two"),
    ("samples: 32", "samples: 4", r":11: samples: at least 16 are needed"),
    ("trajectories: 4", "trajectories: 1", r":12: trajectories: at least 2 are needed"),
    ("metrics: [mean_flow,", "metrics: [mean_flw,", r":5: metrics\[0\]: no metric `mean_flw`.*mean_flow"),
    ("local: [piston_diameter,", "local: [piston_diamete,", r":6: local\[0\]: unknown parameter.*piston_diameter"),
    ("amplitude: {from: 3 mm, to: 4", "amplitude: {from: 4 mm, to: 3", ":9: ranges.amplitude: the range.*empty"),
    ("amplitude: {from: 3 mm, to: 4 mm}", "frequency: {from: 5 Hz, to: 9 Hz}", ":9: ranges.frequency: is fixed by"),
    ("frequency: [10 Hz", "frequency: [10 bar", r":4: points.frequency.values\[0\]: .*not a frequency"),
    ("trajectories: 4", "trajectory: 4", ":12: trajectory: unknown key"),
])  # fmt: skip
def test_an_invalid_configuration_is_refused(task, tmp_path, old, new, says):
    text = task.read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "bad.yaml"
    path.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ConfigError, match=says):
        load_sensitivity(path)
