"""Fits of a diagnosis in worker processes: the same answer, with generated classes and classes of the user's own."""

import concurrent.futures
import multiprocessing
import os
import pickle

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.memory_term import memory_class, oscillator_class
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.result import Verdict
from edhas_jax.diagnosis.search.workers import Workers, _packed, own_classes
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.machine.effects import (
    AsymmetricFriction,
    CoggingForce,
    InverterDeadTime,
    LugreFriction,
    ParasiticSpring,
)
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class
from edhas_jax.measurements.campaign import Channel, Use
from studies.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise

LIBRARY = (AsymmetricFriction, CoggingForce, InverterDeadTime, ParasiticSpring)
CHANNELS = {"voltage": Channel("V", 0.02), "current": Channel("A", 0.02), "piston_position": Channel("mm", 5e-6)}
RUNS = tuple(
    PlannedRun(use, 0.15, {"frequency": frequency, "amplitude": 3.5e-3})
    for use, frequency in ((Use.FIT, 10.0), (Use.FIT, 25.0), (Use.HOLDOUT, 20.0))
)  # fmt: skip
WINDAGE = '''
import jax.numpy as jnp
import edhas_jax as edhas


class Windage(edhas.Effect):
    """Drag with the square of the speed."""

    windage: float = edhas.par(25.0, "N*s^2/m^2", (0.0, 1e3), "drag per squared speed", plausible=(1.0, 200.0))

    def mover_force(self, s, z):
        return -self.windage * s.piston_velocity * jnp.abs(s.piston_velocity)
'''
PLACE = LawPlace("mover_force", "piston_velocity")


@pytest.fixture(scope="module")
def executor():
    with concurrent.futures.ProcessPoolExecutor(2, multiprocessing.get_context("spawn")) as pool:
        yield pool


@pytest.fixture()
def windage(tmp_path):
    """The class of a file of the user."""
    (tmp_path / "windage.py").write_text(WINDAGE)
    spec = f"{tmp_path / 'windage.py'}:Windage"
    return load_effect(spec, trust=[spec])


def campaign_with(*hidden):
    bench = edhas.ActuatorBench(reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(),))
    plan = planned_campaign("bench", bench, {"coil_resistance": 0.02, "mover_damping": 0.25}, CHANNELS, RUNS, 5e-4)
    rng = np.random.default_rng(3)
    truth = draw_parameters(plan, bench, rng)
    return synthesise(plan, structs.replace(truth, effects=(*truth.effects, *hidden)), rng)


@pytest.mark.parametrize(
    "kind", [tabulated_class("spring_deviation", PLACE, 5), memory_class(PLACE), oscillator_class(PLACE)]
)
def test_a_generated_class_is_the_same_class_after_travelling(kind):
    effect = kind()
    again = pickle.loads(_packed(effect))
    assert type(again) is kind
    assert [getattr(again, p.name) for p in structs.parameters(kind)] == [
        getattr(effect, p.name) for p in structs.parameters(kind)
    ]


def test_workers_find_the_effect_of_a_file_of_the_user(executor, windage):
    campaign = campaign_with(windage(windage=60.0))
    here, there = (diagnose(campaign, LIBRARY, more=[windage], executor=pool) for pool in (None, executor))
    assert [c.name for c in here.named] == [c.name for c in there.named] == ["windage"]
    assert there.final.values == pytest.approx(here.final.values, rel=1e-6)
    assert there.final.cost == pytest.approx(here.final.cost, rel=1e-9)
    assert {of.key: of.log_weight for of in there.posterior.sets} == pytest.approx(
        {of.key: of.log_weight for of in here.posterior.sets}, rel=1e-6
    )


def test_workers_fit_the_curve_of_what_nothing_explains(executor, windage):
    campaign = campaign_with(windage(windage=60.0))
    here, there = (diagnose(campaign, LIBRARY, executor=pool) for pool in (None, executor))
    assert there.verdict is here.verdict is Verdict.UNKNOWN_EFFECT
    assert there.free_term.text == here.free_term.text
    assert there.after.cost == pytest.approx(here.after.cost, rel=1e-6)


def test_only_classes_of_the_user_are_their_own(windage):
    assert own_classes([windage, CoggingForce(), edhas.ActuatorBench()]) == (windage,)


def test_a_worker_that_dies_ends_the_diagnosis_in_a_sentence():
    pool = concurrent.futures.ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    with pool, pytest.raises(FitError, match="a worker failed"):
        Workers(pool).map(os._exit, [(3,)])
