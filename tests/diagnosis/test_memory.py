"""What depends on the past: a lag and a resonance that the library does not have, and other laws of a known lag."""

import numpy as np

import edhas_jax as edhas
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.law_deviation import memory_columns
from edhas_jax.diagnosis.candidates.memory_term import MemoryTerm, OscillatorTerm
from edhas_jax.diagnosis.search.result import Verdict
from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.machine.effects import AmplifierLag, Effect, LugreFriction
from edhas_jax.machine.effects.base import state
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter
from studies.synthetic_campaign import planned_campaign, synthesise
from tests.diagnosis.test_diagnose import CHANNELS, RUNS, UNCERTAIN, diagnosed, said

OMEGA = 2.0 * np.pi * 90.0  # 1/s, of a mass on a spring


class HousingMass(Effect):
    """A mass of 50 g on a spring and a damper that moves with the mover: 90 Hz, 4 % of critical damping."""

    housing_mass: float = par(0.05, "kg", (0.0, 1.0), "mass")

    deflection = state("m", "of the spring")
    deflection_rate = state("m/s", "its rate")

    def mover_force(self, s, z):
        return self.housing_mass * (OMEGA * OMEGA * z.deflection + 0.08 * OMEGA * z.deflection_rate)

    def rates(self, s, z):
        # the mover's acceleration is that of the coil's force on the mass of the mover
        acceleration = s.motor_force / 0.5
        own = OMEGA * OMEGA * z.deflection + 0.08 * OMEGA * z.deflection_rate
        return {"deflection": z.deflection_rate, "deflection_rate": -acceleration - own}


def test_a_lag_outside_the_library():
    found = diagnosed(AmplifierLag(amplifier_time=0.6e-3), seed=6)
    assert found.verdict is Verdict.UNKNOWN_EFFECT, said(found)
    assert next(iter(found.posterior.locations())) == "coil"
    assert isinstance(found.free_term, MemoryTerm) and found.free_term.place.slot == "coil_voltage_change"
    assert found.after.excess < 0.2 * found.calibrated.excess


def test_a_resonance_outside_the_library():
    found = diagnosed(HousingMass(), seed=7)
    assert found.verdict is Verdict.UNKNOWN_EFFECT, said(found)
    assert next(iter(found.posterior.locations())) == "mover"
    assert isinstance(found.free_term, OscillatorTerm) and found.free_term.place.slot == "mover_force"
    assert found.after.excess < 0.2 * found.calibrated.excess


def test_memories_of_the_voltage_stand_for_another_lag_of_the_amplifier():
    bench = edhas.ActuatorBench(
        reference=edhas.Sine(ramp_time=0.05), effects=(LugreFriction(), AmplifierLag(amplifier_time=0.6e-3))
    )
    plan = planned_campaign("bench", bench, UNCERTAIN, CHANNELS, RUNS[:1], 5e-4)
    campaign = synthesise(plan, bench, np.random.default_rng(1))
    lag = UnknownParameter("amplifier_lag.amplifier_time", 0.6e-3, 1.0, "s", (1e-6, 1.0), ParameterScale.LINEAR)
    fitted = fit(FitProblem(campaign, bench, (lag,)), np.zeros((1, 1)), search=False)
    columns = memory_columns(fitted, Candidate(AmplifierLag))
    (slopes,), (memories,) = [outcome.sensitivities for outcome in fitted.outcomes], columns
    target = np.concatenate([slopes[n][:, 0] / CHANNELS[n].noise for n in CHANNELS])
    basis_of_memories = np.concatenate([memories[n] / CHANNELS[n].noise for n in CHANNELS])
    left = target - basis_of_memories @ np.linalg.lstsq(basis_of_memories, target)[0]
    assert left @ left < 0.1 * (target @ target)
    assert memory_columns(fitted, Candidate(LugreFriction)) is None
