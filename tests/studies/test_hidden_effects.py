"""The benchmark of hidden effects: drawn cases, a short run with its methods, and what the rivals get."""

import dataclasses
import json

import numpy as np
import pytest

from edhas_jax.diagnosis.candidates.candidate import Candidate, signature_grid
from edhas_jax.inference.fit.calibrated_model import calibrate
from edhas_jax.machine.effects import (
    CoggingForce,
    EntrainedAir,
    ForceConstantDroop,
    InverterDeadTime,
    PistonLeakage,
)
from edhas_jax.machine.rigs import PumpBench
from edhas_jax.measurements.sensor_models import SensorLag
from studies.hidden_effects import benchmark
from studies.hidden_effects.bench_errors import bench_error_changes
from studies.hidden_effects.calibrated_case import exact_fit
from studies.hidden_effects.generators import drawing
from studies.hidden_effects.generators.benches import Bench, planned_runs
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Split
from studies.hidden_effects.generators.varied.benches import PUMP_CHANNELS
from studies.hidden_effects.signatures import signature_table

NULL, NAMED = CaseKey("d", Split.VARIED, 10), CaseKey("d", Split.VARIED, 11)
SMALL = Bench(
    "short runs of a pump", PumpBench, (PistonLeakage, EntrainedAir),
    {"force_constant": 0.02, "load_orifice_area": 0.03}, PUMP_CHANNELS,
    planned_runs(
        {"frequency": 1.0, "amplitude": 1e-3, "load_orifice_area": 1e-6},
        ("fit", 0.16, 30.0, 3.5, 4.2), ("fit", 0.16, 20.0, 3.0, 1.0), ("holdout", 0.16, 25.0, 3.0, 1.5),
    ), 4e-4, 1.0,
)  # fmt: skip


@pytest.fixture
def small(monkeypatch):
    """Three short runs, three effects, two uncertain parameters, and sensors without a chain."""
    library = (InverterDeadTime, CoggingForce, ForceConstantDroop)
    content = dataclasses.replace(CONTENT[Split.VARIED], benches=(SMALL,), library=library, links=())
    monkeypatch.setitem(drawing.CONTENT, Split.VARIED, content)


def test_the_benchmark_runs_its_methods_on_drawn_cases(small, tmp_path, capsys):
    assert [len(draw(key).truth.hidden) for key in (NULL, NAMED)] == [0, 1]
    arguments = ["--split", "varied", "--families", "d", "--first", str(NULL.number), "--cases", "2", "--workers", "1"]
    assert benchmark.main([*arguments, "--out", str(tmp_path), "--methods", "ours,bic,correlation"]) == 0
    line = dict(word.split("=") for word in capsys.readouterr().out.strip().splitlines()[-1].split())
    assert line["ours_in_set"] == line["ours_place"] == "1.000" and float(line["ours_median_s"]) > 0.0
    for method in ("ours", "bic", "correlation"):
        assert line[f"{method}_top1"] == line[f"{method}_adequate_on_nulls"] == "1.000", method
    stored = json.loads((tmp_path / "varied" / str(NAMED) / "ours.json").read_text())
    assert stored["answer_set"] == stored["named"] and 0.5 < stored["probability"] <= 1.0
    (hidden,) = json.loads((tmp_path / "varied" / str(NAMED) / "case.json").read_text())["hidden"]
    assert stored["parameters"][hidden["name"]].keys() == hidden["values"].keys()


def test_rivals_get_the_exact_residual_and_the_grid_of_the_diagnosis(small):
    campaign = draw(NULL).campaign
    calibrated = calibrate(campaign)[0].fit
    model, campaign = calibrated.problem.model(), calibrated.problem.campaign
    fitted, per_sample = exact_fit(calibrated)
    finest = model.predict_all_runs(calibrated.x, 4 * per_sample)
    for r, outcome in enumerate(fitted.outcomes):
        for name, channel in campaign.channels.items():
            difference = outcome.values[name] - finest[r].values[name]
            assert np.sqrt(np.mean(np.square(difference))) < 0.02 * channel.noise
    candidates = [Candidate(CoggingForce), Candidate(SensorLag, "current")]
    table = signature_table(fitted, candidates)
    for suspect, candidate in zip(table.suspects, candidates, strict=True):
        np.testing.assert_array_equal(suspect.points, signature_grid(candidate.unknowns(campaign)))
    assert [s.points.shape[1] for s in table.suspects] == [3, 1]
    # two parameters; gain, offset and shift of five sensors; trigger, orifice, coil and magnets of two runs
    assert table.slopes.shape[1] == 2 + 15 + 8
    whole = np.concatenate([table.slopes, np.eye(table.slopes.shape[1])])
    for vector in (table.projected_residual, *table.projected(table.suspects[0])):
        assert np.abs(whole.T @ vector).max() < 1e-6 * np.linalg.norm(whole) * np.linalg.norm(vector)
    assert np.sqrt(np.mean(np.square(table.unexplained))) == pytest.approx(1.0, abs=0.05)


def test_errors_of_the_bench_are_those_of_its_sensors_and_settings(small):
    campaign = draw(NULL).campaign
    fitted = exact_fit(calibrate(campaign)[0].fit)[0]
    changes = bench_error_changes(fitted)
    before, names = [out.values for out in fitted.outcomes], list(campaign.channels)
    gain, offset, shift = changes[3 * names.index("current") : 3 * names.index("current") + 3]
    sensor = campaign.accuracy.signals["current"]
    for r, run in enumerate(fitted.problem.model().runs):
        current = before[r]["current"]
        np.testing.assert_allclose(gain[r]["current"], sensor.gain * current)
        np.testing.assert_allclose(offset[r]["current"], sensor.offset)
        later, earlier = (
            np.interp(run.time + s, run.time, before[r]["current"]) for s in (-sensor.shift, sensor.shift)
        )
        np.testing.assert_allclose(shift[r]["current"][1:-1], 0.5 * (later - earlier)[1:-1], rtol=1e-6, atol=1e-12)
        assert not np.any(gain[r]["voltage"])
    of_runs = changes[3 * len(names) :]
    for k, of in enumerate(of_runs):
        assert [bool(np.any(run["outlet_flow"])) for run in of] == [r == k % 2 for r in range(2)]
