"""A fit of growing parts of the runs converges where the cost of whole runs has many local minima."""

import dataclasses

import numpy as np
import pytest

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import Candidate, with_candidates
from edhas_jax.inference.fit.evaluated_fit import fit_coarse
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.inference.fit.local_minima import RUN_FRACTIONS, fit_progressively
from edhas_jax.inference.likelihood.bench_deviations import BenchDeviations
from edhas_jax.machine.effects import EntrainedAir, LugreFriction, PistonLeakage, SuctionLineInertance
from edhas_jax.measurements.campaign import Channel, Use
from studies.synthetic_campaign import PlannedRun, draw_parameters, planned_campaign, synthesise

CHANNELS = {
    "current": Channel("A", 0.02), "outlet_pressure": Channel("MPa", 1.5e3), "outlet_flow": Channel("L/min", 2e-7)
}  # fmt: skip
UNCERTAIN = {"force_constant": 0.02, "air_fraction": 0.4, "valve_spring_rate": 0.05, "load_orifice_area": 0.03}
RUNS = tuple(
    PlannedRun(use, 0.2, {"frequency": frequency, "amplitude": 3.5e-3, "load_orifice_area": 3e-6})
    for use, frequency in ((Use.FIT, 20.0), (Use.FIT, 30.0), (Use.HOLDOUT, 25.0))
)
PER_SAMPLE, STEPS = 8, 12


@pytest.fixture(scope="module")
def problem():
    """The fit of a pump whose suction line resonates: the right model, started at a size that is off."""
    bench = edhas.PumpBench(effects=(LugreFriction(), PistonLeakage(), EntrainedAir()))
    plan = planned_campaign("line", bench, UNCERTAIN, CHANNELS, RUNS, 2e-4)
    rng = np.random.default_rng(1)
    truth = draw_parameters(plan, bench, rng)
    truth = structs.replace(truth, effects=(*truth.effects, SuctionLineInertance(line_inertance=1.44e7)))
    return with_candidates(calibration_problem(synthesise(plan, truth, rng)), [Candidate(SuctionLineInertance)])


def test_growing_stretches_reach_what_whole_runs_do_not(problem):
    starts = np.zeros((4, len(problem.unknowns)))
    starts[:, -1] = -1.5, -0.5, 0.5, 1.5
    problem = dataclasses.replace(problem, bench=BenchDeviations())  # they follow the misfit of a short run
    stuck = fit_coarse(problem, starts, PER_SAMPLE, STEPS)
    assert stuck.rms_over_noise(Use.FIT) > 5.0
    found = fit_progressively(problem, np.zeros(5), 1, PER_SAMPLE, STEPS, stuck)
    assert found.rms_over_noise(Use.FIT) == pytest.approx(1.0, abs=0.1)
    assert found.rms_over_noise(Use.HOLDOUT) == pytest.approx(1.0, abs=0.2)
    assert found.fit.values["suction_line_inertance.line_inertance"] == pytest.approx(1.44e7, rel=0.01)
    # from there on nothing is to be gained, which is known without a fit
    assert fit_progressively(problem, found.fit.x, 1, PER_SAMPLE, STEPS, found) is None


def test_stretches_that_fail_are_no_fit(problem):
    unknowns = tuple(dataclasses.replace(u, centre=np.nan) for u in problem.unknowns)
    assert fit_progressively(dataclasses.replace(problem, unknowns=unknowns), np.zeros(5), 1, PER_SAMPLE, STEPS) is None
    assert list(RUN_FRACTIONS) == sorted(RUN_FRACTIONS) and RUN_FRACTIONS[-1] < 1.0
