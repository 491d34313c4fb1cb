"""Campaigns that are planned but not measured: their description is read, their signals are predicted."""

import dataclasses
import math
from pathlib import Path

import numpy as np

from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.planning.candidate_runs import periodic_duration
from edhas_jax.measurements.campaign import CAMPAIGN_FILE, BenchRun, Campaign, CampaignError
from edhas_jax.measurements.campaign_reader import CampaignDescription, read_campaign, read_description
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.run_reader import RunEntry

APERIODIC_DURATION = 0.6  # s, of a run whose set point is not periodic
MIN_PLANNED_SAMPLES, MAX_PLANNED_SAMPLES = 100, 200_000  # of a run


class PlannedCampaignDescription(CampaignDescription):
    """The description of a campaign whose runs need not have data files."""

    def planned_runs(self, rate: float) -> tuple[BenchRun, ...]:
        """The runs without signals, sampled at `rate` [Hz] for some cycles of their set point.

        Raises:
            CampaignError: the set point is a recording, or a run would have too few or too many samples.
        """
        for drive, source in self.recorded.items():
            own = drive in self.rig.drives
            instead = "write files with the columns of the drives alone" if own else "describe the set point"
            raise CampaignError(
                f"{self.folder / CAMPAIGN_FILE}: `{drive}: {source.column}` is recorded with the runs, "
                f"so they cannot be planned before they are made; {instead} instead"
            )
        return tuple(self._planned_run(entry, rate) for entry in self.run_entries)

    def _planned_run(self, entry: RunEntry, rate: float) -> BenchRun:
        duration, file = periodic_duration(self.machine, entry.conditions) or APERIODIC_DURATION, entry.file
        low, high = entry.timing.window
        duration = high if math.isfinite(high) else max(duration, low + duration)
        if duration * rate < MIN_PLANNED_SAMPLES:
            raise CampaignError(f"{file}: has {duration * rate:.0f} samples at {format_quantity(rate, 'Hz')}, at least "
                                f"{MIN_PLANNED_SAMPLES} are needed; raise the sampling rate")  # fmt: skip
        if duration * rate > MAX_PLANNED_SAMPLES:
            count = f"{duration * rate:.3g} samples at {format_quantity(rate, 'Hz')}"
            most = f"at most {MAX_PLANNED_SAMPLES:,} can be planned"
            raise CampaignError(f"{file}: has {count}, {most}; lower the sampling rate")
        time = np.arange(round(duration * rate) + 1) / rate
        time = time[time >= low - 0.5 / rate]
        lines = np.arange(len(time)) + 2
        return BenchRun(entry.name, file, entry.use, entry.conditions, time, {}, lines, uncertain=entry.uncertain)


def read_planned_campaign(path: Path | str, rate: float, trust: Trust = ()) -> Campaign:
    """Read the campaign in a folder, with planned runs in place of those that have no data file yet.

    Args:
        path: the folder, or its `campaign.yaml`.
        rate: sampling rate [Hz] of the planned runs.
        trust: as for `read_campaign`.

    Returns:
        The campaign: with its measured runs if all data files exist, else with planned runs only. The files of a rig
        of one's own whose drives are recorded may hold these drives alone.

    Raises:
        CampaignError: `campaign.yaml` is invalid (every problem, one line each), its set point is a recording, or
            `rate` leaves a run with too few or too many samples.
    """
    if not rate > 0.0:
        raise CampaignError(f"the sampling rate must be above 0, for example 5 kHz; got {format_quantity(rate, 'Hz')}")
    path = Path(path)
    file = path / CAMPAIGN_FILE if path.is_dir() else path
    description, _ = read_description(file, PlannedCampaignDescription, trust)
    own_drives = any(name in description.rig.drives for name in description.recorded)
    if own_drives and all(file.path.exists() for entry in description.run_entries for file in entry.files):
        return read_campaign(path, trust, planned=True)
    planned = description.planned_runs(rate)
    measured, remarks = (), ()
    if all(run.file.exists() for run in planned):
        campaign = read_campaign(path, trust)
        measured, remarks = campaign.runs, campaign.remarks
    runs = tuple(r for run in planned for r in [m for m in measured if m.whole == run.name] or [run])
    return Campaign(
        description.name, file.parent, description.machine, description.uncertain, description.channels, runs, remarks,
        stated_accuracy=description.accuracy,
    )  # fmt: skip


def with_predicted_signals(campaign: Campaign, per_sample: int) -> Campaign:
    """Replace the signals of every run by those that the campaign's own model predicts.

    Args:
        campaign: runs with or without signals.
        per_sample: integration steps per sample.

    Returns:
        The campaign with predictions for the signals that a run has, or for all channels where it has none.
    """
    model = MeasurementModel(campaign, campaign.machine, (), campaign.runs)
    outcomes = model.predict_all_runs(np.zeros(0), per_sample)
    runs = tuple(
        dataclasses.replace(run, signals={n: outcomes[r].values[n] for n in run.signals or campaign.channels})
        for r, run in enumerate(campaign.runs)
    )
    return dataclasses.replace(campaign, runs=runs, is_checked=True)  # predictions have no noise to measure
