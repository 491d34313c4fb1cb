"""Write a case as a campaign folder for `edhas diagnose`, and the truth about it beside the folder."""

import json
from pathlib import Path

from edhas_jax.core.atomic_file import atomic_write
from edhas_jax.measurements.campaign_writer import write_campaign
from studies.hidden_effects.generators.hidden_case import HiddenCase


def write_case(case: HiddenCase, folder: Path) -> Path:
    """Write the campaign of a case into a new or empty folder, and its truth into `<folder>.json`.

    Returns:
        The file with the truth.

    Raises:
        CampaignError: the folder is not empty, or cannot be written.
    """
    write_campaign(case.campaign, folder)
    truth = {
        "family": case.family.value,
        "split": case.split.value,
        "number": case.number,
        "description": case.description,
        "bench": case.bench,
        "hidden": [
            {"candidate": h.candidate, "locations": list(h.locations), "law": h.law, "values": h.values,
             "visible": h.visible}
            for h in case.hidden
        ],
        "withheld": [kind.id for kind in case.withheld],
        "disturbances": case.disturbances,
        "disturbances_visible": case.disturbances_visible,
        "chain": list(case.chain),
        "settings": list(case.settings),
        "true_noise": case.true_noise,
    }  # fmt: skip
    path = folder.with_name(f"{folder.name}.json")
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(truth, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return path
