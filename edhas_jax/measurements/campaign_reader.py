"""Read a campaign: a folder with `campaign.yaml` and one file per run."""

import dataclasses
from pathlib import Path

from edhas_jax.core import structs
from edhas_jax.core.trusted_code import Trust
from edhas_jax.measurements.campaign import Campaign, CampaignError, Remark, Severity, brief_lines
from edhas_jax.measurements.campaign_description import CAMPAIGN_FILE, read_description
from edhas_jax.measurements.checks.unit_checks import limits_remarks
from edhas_jax.measurements.fitted_model import results_beside
from edhas_jax.measurements.run_reader import RunReader

OF_RUNS = "of_runs"  # key of a result: by run and parameter, what was estimated of the run alone


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
    reader = RunReader(description.machine, description.sources, description.recorded, planned)
    runs = [run for entry in description.run_entries for run in reader.read(entry)]
    remarks = (*remarks, *reader.remarks)
    if not runs:
        raise CampaignError("\n".join([*brief_lines(remarks), f"{path}: no run can be used"]))
    machine = description.machine
    if runs[0].recordings:
        machine = structs.replace(machine, **runs[0].recordings)
    campaign = Campaign(
        description.name, path.parent, machine, description.uncertain, description.channels, tuple(runs), remarks,
        stated_accuracy=description.accuracy, file=path,
    )  # fmt: skip
    return dataclasses.replace(campaign, remarks=(*remarks, *limits_remarks(campaign)))


def with_values_of_runs(campaign: Campaign, model: Path | str) -> Campaign:
    """A campaign whose runs have, as conditions, what was estimated of them together with a model.

    Args:
        campaign: the campaign.
        model: file of the configuration of the model; the result of its fit lies beside it.

    Returns:
        The campaign; itself where there is no such result, or the runs have nothing of their own.
    """
    for file, found in results_beside(model):
        try:
            own = {run: {n: float(row["value"]) for n, row in rows.items()} for run, rows in found[OF_RUNS].items()}
        except (ValueError, KeyError, TypeError, AttributeError):
            continue
        known = {run.whole: own.get(run.whole, {}).keys() & run.uncertain.keys() for run in campaign.runs}
        if not any(known.values()):
            return campaign
        conditions = [r.conditions | {n: own[r.whole][n] for n in known[r.whole]} for r in campaign.runs]
        runs = (dataclasses.replace(r, conditions=c) for r, c in zip(campaign.runs, conditions, strict=True))
        names = ", ".join(sorted(set().union(*known.values())))
        sentence = f"{names}: the values of the runs are those that were estimated with the model ({file.name})"
        remark = Remark(Severity.NOTE, campaign.folder / CAMPAIGN_FILE, 0, sentence)
        return dataclasses.replace(campaign, runs=tuple(runs), remarks=(*campaign.remarks, remark))
    return campaign


def as_campaign(source: Campaign | Path | str, trust: Trust = ()) -> Campaign:
    """A campaign, or the one in a folder; errors as of `read_campaign`."""
    return source if isinstance(source, Campaign) else read_campaign(source, trust)
