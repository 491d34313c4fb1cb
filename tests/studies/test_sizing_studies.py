"""The studies of sensitivity and sizing in short form: they run through and find what they should."""

import importlib

import pytest

from tests.design.test_sizing import CONFIG, ROBUST
from tests.support import CONFIGS
from tests.support.headline import headline


def study(name: str):
    return importlib.import_module(f"studies.{name}").main


@pytest.fixture
def task(tmp_path):
    path = tmp_path / "task.yaml"
    path.write_text(CONFIG, encoding="utf-8")
    return str(path)


def test_sizing_against_sweep(task, tmp_path, capsys):
    found = study("sizing.sizing_against_sweep")(
        ["--config", task, "--points", "128", "--starts", "2", "--iterations", "5", "--out", str(tmp_path / "out")]
    )
    assert float(headline(capsys)["gain"]) == pytest.approx(found["gain"], rel=1e-3)
    assert found["gain"] > -1e-3 and found["violation"] <= 2e-3


def test_pareto_front(task, tmp_path, capsys):
    found = study("sizing.pareto_front")(["--config", task, "--designs", "2", "--starts", "1", "--iterations", "5",
                                   "--out", str(tmp_path / "out")])  # fmt: skip
    printed = headline(capsys)
    assert printed["designs"] == "2" and float(printed["flow_ratio"]) == pytest.approx(found["flow_ratio"], rel=5e-3)
    assert found["flow_ratio"] > 1.0 and (tmp_path / "out" / "sized_2.yaml").is_file()


def test_robust_design(tmp_path, capsys):
    path = tmp_path / "robust.yaml"
    text = CONFIG.replace("[10 Hz, 25 Hz]", "[25 Hz]").replace("starts: 4\n", "starts: 4\n" + ROBUST)
    path.write_text(text, encoding="utf-8")
    found = study("sizing.robust_design")(
        ["--config", str(path), "--machines", "60", "--starts", "1", "--iterations", "5"]
        + ["--out", str(tmp_path / "out")]
    )
    assert set(headline(capsys)) == set(found)
    assert found["robust_kept"] >= found["nominal_kept"] and found["robust_kept"] > 0.95


def test_sensitivity_map(tmp_path, capsys):
    from tests.design.test_sensitivity import CONFIG as sensitivity

    path = tmp_path / "map.yaml"
    path.write_text(sensitivity.format(base=CONFIGS / "paper.yaml"), encoding="utf-8")
    found = study("sizing.sensitivity_map")(["--config", str(path), "--samples", "16", "--out", str(tmp_path / "out")])
    assert headline(capsys)["mean_flow_slowest"] == found["slowest"]
    assert found["slowest"] in ("piston_diameter", "amplitude")


def test_design_space(task, tmp_path, capsys):
    found = study("sizing.design_space")(["--config", task, "--points", "64", "--out", str(tmp_path / "out")])
    printed = headline(capsys)
    assert printed["designs"] == "64" and int(printed["sound"]) == pytest.approx(64 * found["sound"])
    assert found["sound"] > 0.9


def test_flow_over_frequency(tmp_path, capsys):
    found = study("flow_drop.flow_over_frequency")(["--points", "6", "--out", str(tmp_path / "out")])
    assert headline(capsys)["because_of"] == "valves_without_delay"
    assert 25.0 < found["highest_at_hz"] < 45.0
    assert found["valves without delay"] > 0.2 > abs(found["unlimited voltage"])
