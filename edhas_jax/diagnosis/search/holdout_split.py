"""Hold-out data of a campaign that has no hold-out runs: the last part of each run."""

import dataclasses
from typing import NamedTuple

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use, count_runs

FITTED_SHARE = 2.0 / 3.0  # of the measured samples of a run, its first part
FITTED_NAME, HELD_OUT_NAME = ", first part", ", last part"  # added to the name of the run
MIN_PART_SAMPLES = 10  # of either part; a shorter run is not divided


class HoldoutSplit(NamedTuple):
    """A campaign with hold-out data, and a sentence on how they were chosen; empty where the campaign has its own."""

    campaign: Campaign
    sentence: str


def split_for_holdout(campaign: Campaign) -> HoldoutSplit:
    """Hold out the last third of each run where a campaign has no hold-out runs.

    Both parts keep the time of the run, so that the second one is simulated from the beginning of the run too. A
    campaign whose runs are too short is returned as it is.
    """
    if campaign.runs_for(Use.HOLDOUT):
        return HoldoutSplit(campaign, "")
    runs: list[BenchRun] = []
    for run in campaign.runs:
        runs += _parts(run)
    if len(runs) == len(campaign.runs):
        return HoldoutSplit(campaign, "")
    ends = [f"{run.name} at {format_quantity(float(run.time[0]), 's')}" for run in runs if run.use is Use.HOLDOUT]
    divided = "The run was divided" if count_runs(campaign.runs) == 1 else "Each run was divided"
    sentence = (
        f"No run of the campaign is held out. {divided} by time: its first two thirds are fitted, the rest is held out "
        f"({', '.join(end.replace(HELD_OUT_NAME, '') for end in ends)}). A run of its own with `use: holdout` is a "
        "stricter test."
    )
    return HoldoutSplit(dataclasses.replace(campaign, runs=tuple(runs)), sentence)


def _parts(run: BenchRun) -> list[BenchRun]:
    """The fitted and the held-out part of a run; the run itself where it is too short."""
    measured = np.sum([np.isfinite(values) for values in run.signals.values()], axis=0)
    total = np.cumsum(measured)
    cut = int(np.searchsorted(total, FITTED_SHARE * total[-1])) + 1
    if min(cut, len(run.time) - cut) < MIN_PART_SAMPLES or not measured[cut:].any():
        return [run]
    parts = (Use.FIT, slice(None, cut), FITTED_NAME), (Use.HOLDOUT, slice(cut, None), HELD_OUT_NAME)
    return [
        dataclasses.replace(
            run, name=run.name + words, part_of=run.whole, use=use, time=run.time[samples], lines=run.lines[samples],
            signals={name: values[samples] for name, values in run.signals.items()},
        )
        for use, samples, words in parts
    ]  # fmt: skip
