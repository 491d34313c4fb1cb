"""The studies of fitting, in short form."""

import dataclasses
import importlib

import numpy as np
import pytest

from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.measurements.campaign import Use
from edhas_jax.measurements.unknown_parameters import uncertain_unknowns
from tests.support.synthetic_campaign import bench, empty_campaign


def load(name):
    return importlib.import_module(f"studies.{name}")


def test_lugre_friction_is_identified():
    study = load("identification.friction")
    study.SPEEDS, study.CREEPS = (5e-3, 20e-3, 80e-3), (60e-6,)
    found = study.identify(study.measure(study.experiments()))
    for name, value in found.values.items():
        assert abs(value - study.TRUTH[name]) < 4.0 * found.standard_errors[name], name
        assert found.standard_errors[name] < 0.4 * study.TRUTH[name]
    assert study.draw(found).axes


def test_error_bars_hold():
    study = load("identification.fit_coverage")
    campaign = empty_campaign(bench(), lengths=(201, 201, 201))
    distances = study.study(campaign, 4)
    assert distances.shape == (4, len(uncertain_unknowns(campaign)))
    assert (np.abs(distances) <= 1.96).mean() >= 0.75
    assert "all" in study.report(campaign, distances)


def test_the_drive_study_finds_what_it_put_in(monkeypatch):
    """The friction of the drive, on a record made from it: the real record is not part of the project."""
    study = load("emps.published_comparison")
    names = study.MODELS["asymmetric"][1]
    assert set(names) < {p for p in study.DriveFriction.__dataclass_fields__}
    found = study.DriveFriction(dry_ratio=1.03, viscous_ratio=1.4)

    class Here:
        piston_velocity = -0.1

    force = float(found.mover_friction(Here, None))
    assert force == pytest.approx(-(1.03 * 20.0 + 1.4 * 20.0), rel=1e-6)


def test_the_drive_record_is_cut_where_it_is_back():
    """Two strokes: the second half begins where the first one did, has its own set point, and is held out."""
    study = load("emps.discovery")
    time = 1e-2 * np.arange(801)
    position = np.where(time < 4.3, 1.0 - np.cos(2 * np.pi * time / 4.3), 1.0 - np.cos(2 * np.pi * (time - 4.3) / 3.7))
    campaign = empty_campaign(bench())
    signals = {"piston_position": position, "voltage": 3.0 + time}
    run = dataclasses.replace(campaign.runs[0], time=time, signals=signals, lines=np.arange(801) + 2)
    run = dataclasses.replace(run, reference=Recorded(values=0.1 * position, interval=1e-2))
    first, second = study.halved(dataclasses.replace(campaign, runs=(run,))).runs
    assert [first.use, second.use] == [Use.FIT, Use.HOLDOUT]
    assert len(first.time) == 430 and second.time[0] == 0.0 and second.lines[0] == 432
    np.testing.assert_array_equal(second.reference.values, 0.1 * position[430:])
    assert np.isnan(second.signals["voltage"][:10]).all() and second.signals["voltage"][10] == pytest.approx(7.4)
