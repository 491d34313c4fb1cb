"""What the checks did to the data of a campaign, in sentences beside every result and as plain data."""

from collections.abc import Iterable
from typing import Any

from edhas_jax.core.remark import Severity
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.noise_measurement import noise_as_json, noise_sentence

MAX_LISTED = 3  # remarks that are quoted


def data_sentences(campaign: Campaign, findings: Iterable[str] = ()) -> list[str]:
    """The findings of a result between two remarks on its data, where there are any.

    Args:
        campaign: the checked measurements.
        findings: sentences on the result.

    Returns:
        The difference between stated and measured noise, the findings, and what is not used of the data.
    """
    sentences = [*([] if (noise := noise_sentence(campaign)) is None else [noise]), *findings]
    errors = [r for r in campaign.remarks if r.severity is Severity.ERROR]
    for remark in errors[:MAX_LISTED]:
        sentences.append(f"Not used: {remark.file.name}: {remark.sentence.removesuffix('; left out')}.")
    if len(errors) > MAX_LISTED:
        sentences.append(f"Not used: {len(errors) - MAX_LISTED} more; `edhas campaign check` lists all.")
    return sentences


def data_as_json(campaign: Campaign) -> dict[str, Any]:
    """The noise of every signal as stated, measured and used (SI), what is left out, and all remarks on the data."""
    return {
        "noise": noise_as_json(campaign), "removed": [removal._asdict() for removal in campaign.removed],
        "remarks": [str(remark) for remark in campaign.remarks],
    }  # fmt: skip
