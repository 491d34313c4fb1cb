"""Do the error bars of a fit hold? Campaigns are made from drawn parameters and fitted; how often is the truth inside?

    python -m studies.identification.fit_coverage CAMPAIGN [COUNT]

Each campaign has the runs, sensors and uncertainties of the one given; its parameters are drawn from their spread
(log-normal, clipped at two standard deviations), its signals simulated at a step that the fit does not use, and given
white noise. The true value lies inside the 95 % interval in about that share of all cases, if the errors are right.
"""

import argparse
import dataclasses
import time
from pathlib import Path

import numpy as np

from edhas_jax.diagnosis.calibration.fit import FitProblem, fit
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution
from edhas_jax.measurements.unknown_parameters import UnknownParameter, uncertain_unknowns

MADE_FINER = 9  # steps of the synthetic bench for one of the fit


def synthesise(
    campaign: Campaign,
    unknowns: tuple[UnknownParameter, ...],
    truth: np.ndarray,
    per_sample: int,
    rng: np.random.Generator,
) -> Campaign:
    """The campaign as it would have been measured on a machine with the coordinates `truth`."""
    model = MeasurementModel(campaign, campaign.machine, unknowns, campaign.runs)
    outcomes = model.predict_all_runs(truth, per_sample)

    def measured(r: int, run: BenchRun) -> BenchRun:
        signals = {
            n: values + campaign.channels[n].noise * rng.standard_normal(len(values))
            for n, values in outcomes[r].values.items()
        }
        return dataclasses.replace(run, signals=signals)

    return dataclasses.replace(campaign, runs=tuple(measured(r, run) for r, run in enumerate(campaign.runs)))


def study(campaign: Campaign, count: int, seed: int = 1) -> np.ndarray:
    """Distance of the estimates from the truth in standard errors (count, unknowns)."""
    unknowns = uncertain_unknowns(campaign)
    rng = np.random.default_rng(seed)
    model = MeasurementModel(campaign, campaign.machine, unknowns, campaign.runs_for(Use.FIT))
    chosen = choose_time_resolution(model, np.zeros(len(unknowns)))
    out = np.empty((count, len(unknowns)))
    for k in range(count):
        truth = np.clip(rng.standard_normal(len(unknowns)), -2.0, 2.0)
        made = synthesise(campaign, unknowns, truth, MADE_FINER * chosen.fine, rng)
        began = time.perf_counter()
        problem = FitProblem(made, made.machine, unknowns)
        found = fit(problem, starts=1, resolution=TimeResolution(*chosen[:2], chosen.error))
        out[k] = (found.x - truth) / found.std
        inside = int((np.abs(out[k]) <= 1.96).sum())
        print(f"campaign {k + 1}: {inside} of {len(unknowns)} inside, {time.perf_counter() - began:.1f} s", flush=True)
    return out


def report(campaign: Campaign, distances: np.ndarray) -> str:
    """The share inside the 95 % interval by unknown, as text."""
    inside = np.abs(distances) <= 1.96
    names = [u.name for u in uncertain_unknowns(campaign)]
    rows = [f"{n:24s} {share:6.1%}   rms distance {rms:.2f}" for n, share, rms in
            zip(names, inside.mean(axis=0), np.sqrt(np.mean(distances**2, axis=0)), strict=True)]  # fmt: skip
    return "\n".join([*rows, f"{'all':24s} {inside.mean():6.1%}"])


def main(arguments: list[str] | None = None) -> None:
    """Make and fit the campaigns, print the share of intervals that hold the true value."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("campaign", type=Path, help="folder of the campaign")
    parser.add_argument("count", type=int, nargs="?", default=20, help="campaigns to make and fit")
    options = parser.parse_args(arguments)
    campaign = read_campaign(options.campaign)
    distances = study(campaign, options.count)
    print(report(campaign, distances))
    print(f"campaigns={options.count} coverage_95={(np.abs(distances) <= 1.96).mean():.3f}")


if __name__ == "__main__":
    main()
