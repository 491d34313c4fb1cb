"""Coverage of the confidence intervals of a fit on synthetic campaigns with known parameters.

    python -m studies.identification.fit_coverage CAMPAIGN [COUNT]

Each synthetic campaign has the runs, sensors and uncertainties of CAMPAIGN. Its parameters are drawn from their prior
(log-normal, clipped at two standard deviations and kept in the order that their laws prescribe), its signals are
simulated with a finer step than the fit uses, and white noise is added. If the standard errors are right, the true
value lies inside the 95 % interval in 95 % of cases.
"""

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np

from edhas_jax.inference.fit.fit import fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution
from edhas_jax.measurements.unknown_parameters import UnknownParameter, uncertain_unknowns

STEP_RATIO = 9  # steps of the synthetic data per step of the fit
NORMAL_95 = 1.96  # standard deviations of a two-sided 95 % interval


def synthesise(
    campaign: Campaign,
    unknowns: tuple[UnknownParameter, ...],
    truth: np.ndarray,
    per_sample: int,
    rng: np.random.Generator,
) -> Campaign:
    """Make the measurements of a campaign on a machine with known parameters.

    Args:
        campaign: runs, channels and noise levels.
        unknowns: the parameters that vary.
        truth: their normalised values, in prior standard deviations from the prior mean, shape (unknowns,).
        per_sample: time steps per sample.
        rng: generator of the noise.
    """
    model = MeasurementModel(campaign, campaign.machine, unknowns, campaign.runs)
    outcomes = model.predict_all_runs(truth, per_sample)

    def measured(r: int, run: BenchRun) -> BenchRun:
        signals = {
            n: values + campaign.channels[n].noise * rng.standard_normal(len(values))
            for n, values in outcomes[r].values.items()
        }
        return dataclasses.replace(run, signals=signals)

    return dataclasses.replace(campaign, runs=tuple(measured(r, run) for r, run in enumerate(campaign.runs)))


def normalised_errors(campaign: Campaign, count: int, seed: int = 1) -> np.ndarray:
    """Errors of the estimates of `count` synthetic campaigns in standard errors, shape (count, unknowns)."""
    unknowns = uncertain_unknowns(campaign)
    rng = np.random.default_rng(seed)
    model = MeasurementModel(campaign, campaign.machine, unknowns, campaign.runs_for(Use.FIT))
    resolution = choose_time_resolution(model, np.zeros(len(unknowns)))
    errors = np.empty((count, len(unknowns)))
    laws, two = FitProblem(campaign, campaign.machine, unknowns).constraints(), np.full(len(unknowns), 2.0)
    for k in range(count):
        truth = laws.project(rng.standard_normal(len(unknowns)), -two, two)
        synthetic = synthesise(campaign, unknowns, truth, STEP_RATIO * resolution.fine, rng)
        began = time.perf_counter()
        problem = FitProblem(synthetic, synthetic.machine, unknowns)
        fitted = fit(problem, starts=1, resolution=TimeResolution(*resolution[:2], resolution.error))
        errors[k] = (fitted.x - truth) / fitted.std
        inside = int((np.abs(errors[k]) <= NORMAL_95).sum())
        print(f"campaign {k + 1}: {inside} of {len(unknowns)} inside, {time.perf_counter() - began:.1f} s", flush=True)
    return errors


def report(campaign: Campaign, errors: np.ndarray) -> str:
    """The share inside the 95 % interval and the rms normalised error of each unknown, as text."""
    inside = np.abs(errors) <= NORMAL_95
    names = [u.name for u in uncertain_unknowns(campaign)]
    rows = [f"{n:24s} {share:6.1%}   rms error / standard error {rms:.2f}" for n, share, rms in
            zip(names, inside.mean(axis=0), np.sqrt(np.mean(errors**2, axis=0)), strict=True)]  # fmt: skip
    return "\n".join([*rows, f"{'all':24s} {inside.mean():6.1%}"])


def main(arguments: list[str] | None = None) -> None:
    """Make and fit the campaigns, print the share of intervals that contain the true value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, help="folder of the campaign")
    parser.add_argument("count", type=int, nargs="?", default=20, help="campaigns to make and fit")
    options = parser.parse_args(arguments)
    campaign = read_campaign(options.campaign)
    errors = normalised_errors(campaign, options.count)
    print(report(campaign, errors))
    print(f"campaigns={options.count} coverage_95={(np.abs(errors) <= NORMAL_95).mean():.3f}")


if __name__ == "__main__":
    main()
