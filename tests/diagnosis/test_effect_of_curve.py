"""A mechanism that acts by quite another law is named by the curve that explains it."""

import dataclasses

import numpy as np
import pytest

from edhas_jax.core.structs import par
from edhas_jax.diagnosis.laws.deviation import curve_columns
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.effect_of_curve import _is_smooth, round_with_effect_of_curve
from edhas_jax.diagnosis.search.free_curves import free_curve
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.trial import try_candidate
from edhas_jax.machine.effects import Effect, ForceConstantDroop
from edhas_jax.machine.effects.tabulated_law import LawPlace, table_of
from edhas_jax.measurements.time_resolution import TimeResolution
from tests.diagnosis.test_diagnose import diagnosed, errors, evidence


class TiltedForceConstant(Effect):
    """A force constant that rises along the stroke, which a droop to both sides cannot follow."""

    tilt: float = par(0.1, "-", (-1.0, 1.0), "rise over 5 mm")

    def force_constant_factor(self, s, z):
        return 1.0 + self.tilt * s.piston_position / 5e-3


@pytest.fixture(scope="module")
def of_a_tilted_force_constant() -> Diagnosis:
    """The diagnosis of a bench whose force constant does not droop to both sides, but rises along the stroke."""
    return diagnosed(TiltedForceConstant(tilt=0.12), seed=8)


def slope_near_zero(model) -> float:
    """The slope [1/m] of the deviation of the droop within 3 mm of mid-stroke."""
    table = table_of(next(e for e in model.fit.machine.effects if e.id == "force_constant_droop_deviation"))
    inside = np.abs(table.nodes) < 3e-3
    return np.polyfit(table.nodes[inside], table.values[inside], 1)[0]


def test_a_mechanism_with_quite_another_law_is_named_by_its_slot(of_a_tilted_force_constant):
    found = of_a_tilted_force_constant
    assert [t.candidate for t in found.named] == [Candidate(ForceConstantDroop)], evidence(found)
    assert [m.law_differs for m in found.members] == [True]
    assert slope_near_zero(found.after) == pytest.approx(0.12 / 5e-3, rel=0.15)
    assert errors(found)[2] == pytest.approx(1.0, abs=0.1)


def test_a_curve_is_the_law_of_the_one_effect_of_its_slot(of_a_tilted_force_constant):
    """Even if its own trial failed; not where several effects share the slot, or the curve is over another signal."""
    first = dataclasses.replace(of_a_tilted_force_constant.rounds[0], trials=(), accepted=None, laws=())
    baseline, coarse = first.baseline, first.baseline.fit.resolution.coarse
    resolution, ends = TimeResolution(coarse, coarse, 0.0), []
    for slot, variable in (
        ("force_constant_factor", "piston_position"), ("mover_force", "piston_position"),
        ("force_constant_factor", "current"),
    ):  # fmt: skip
        curve = free_curve(baseline.fit, LawPlace(slot, variable))
        columns = curve_columns(baseline.fit, curve.place, np.array(curve.nodes))
        scaled = [{n: curve.spread * v for n, v in run.items()} for run in columns]
        trial = try_candidate(baseline, (), ScoreTest(baseline.fit, ()).score_columns(curve, scaled), resolution, 12)
        ends.append(round_with_effect_of_curve(first, trial, (), resolution))
    end, *others = ends
    assert others == [None, None]
    assert end.round.accepted.candidate == Candidate(ForceConstantDroop) and len(end.round.laws) == 1
    assert end.baseline.excess < 0.05 * baseline.excess
    assert slope_near_zero(end.baseline) == pytest.approx(0.12 / 5e-3, rel=0.15)


def test_a_ripple_is_no_law_of_the_library(of_a_tilted_force_constant):
    """A monotonic, parabolic, kinked or stepped curve may be the law of an effect; a sinusoidal ripple is not."""
    curve = free_curve(of_a_tilted_force_constant.rounds[0].baseline.fit,
                       LawPlace("force_constant_factor", "piston_position"))  # fmt: skip
    x = np.array(curve.nodes) / np.max(np.abs(curve.nodes))
    shapes = {"rise": x, "droop": x**2, "kink": np.maximum(x, 0.0), "step": np.sign(x), "ripple": np.sin(12.0 * x)}
    smooth = {name: _is_smooth(curve, dict(zip(curve.value_names, y, strict=True))) for name, y in shapes.items()}
    assert smooth == {"rise": True, "droop": True, "kink": True, "step": True, "ripple": False}
