"""Limits on deviations of the bench while a model leaves much unexplained.

Deviations of settings and sensors have priors, not limits. Where a model leaves a residual of many times the noise, χ²
pays for a setting that is a hundred times its accuracy off, which hides the missing effect and distorts all parameters.
As long as the residual is r times the noise, r clearly above 1, deviations are therefore allowed 1/r of their accuracy:
their priors then weigh as if the noise were as large as the residual.
"""

import dataclasses

from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.likelihood.bench_deviations import bench_deviations
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse

MIN_RESIDUAL = 1.5  # over the noise: what a bench with many small causes may leave
SAME = 1.25  # ratio of two limits below which they count as the same
MAX_REPETITIONS = 3  # a fit with tighter deviations leaves a larger residual
FIT_STEPS = 8  # maximum number of Levenberg-Marquardt steps


def with_tightened_bench(evaluated: EvaluatedFit, steps_per_sample: int) -> EvaluatedFit:
    """The fit with deviations of the bench as tight as its residual demands; the given one where they are.

    Args:
        evaluated: a fit.
        steps_per_sample: time steps per sample.
    """
    found = evaluated
    for _ in range(MAX_REPETITIONS):
        problem = found.fit.problem
        residual = found.residual_over_noise
        wanted, present = residual if residual > MIN_RESIDUAL else 1.0, problem.campaign.tightening
        if max(wanted / present, present / wanted) < SAME:
            break
        campaign = dataclasses.replace(problem.campaign, tightening=wanted)
        problem = dataclasses.replace(problem, campaign=campaign, bench=bench_deviations(campaign, problem.unknowns))
        try:
            found = fit_coarse(problem, found.fit.x, steps_per_sample, FIT_STEPS)
        except FitError:
            break
    return found
