"""Read a campaign: a folder with `campaign.yaml` and one file per run."""

import dataclasses
from pathlib import Path

from edhas_jax.core import structs
from edhas_jax.core.trusted_code import Trust
from edhas_jax.measurements.campaign import Campaign, CampaignError
from edhas_jax.measurements.campaign_description import CAMPAIGN_FILE, read_description
from edhas_jax.measurements.remark_list import brief_lines
from edhas_jax.measurements.run_reader import RunReader
from edhas_jax.measurements.sensor_keys import limits_remarks


def read_campaign(path: Path | str, trust: Trust = (), planned: bool = False) -> Campaign:
    """Read a campaign.

    Args:
        path: its folder, or its `campaign.yaml`.
        trust: Python files (or modules) of your own that may run if the campaign names them, besides those that were
            allowed by `edhas trust`.
        planned: whether the files of the runs may hold recorded drives alone, without any measured signal.

    Returns:
        The campaign in SI units. `Campaign.remarks` lists the data that are left out, and those that look wrong.

    Raises:
        CampaignError: `campaign.yaml` is wrong (every problem, one line each), or no run can be used.
    """
    path = Path(path)
    path = path / CAMPAIGN_FILE if path.is_dir() else path
    description, remarks = read_description(path, trust=trust)
    reader = RunReader(description.machine, description.time, description.sources, description.recorded, planned)
    runs = [run for entry in description.run_entries if (run := reader.read(*entry)) is not None]
    remarks = (*remarks, *reader.remarks)
    if not runs:
        raise CampaignError("\n".join([*brief_lines(remarks), f"{path}: no run can be used"]))
    machine = description.machine
    if runs[0].recordings:
        machine = structs.replace(machine, **runs[0].recordings)
    campaign = Campaign(
        description.name, path.parent, machine, description.uncertain, description.channels, tuple(runs), remarks,
        stated_accuracy=description.accuracy,
    )  # fmt: skip
    return dataclasses.replace(campaign, remarks=(*remarks, *limits_remarks(campaign)))


def as_campaign(source: Campaign | Path | str, trust: Trust = ()) -> Campaign:
    """A campaign, or the one in a folder; errors as of `read_campaign`."""
    return source if isinstance(source, Campaign) else read_campaign(source, trust)
