"""What the checks did to the data of a campaign, in sentences for the beginning of every result and as plain data."""

from typing import Any

from edhas_jax.measurements.campaign import Campaign, Severity
from edhas_jax.measurements.checks.noise_measurement import noise_as_json, noise_sentence

MAX_LISTED = 3  # remarks that are quoted


def data_sentences(campaign: Campaign) -> list[str]:
    """The difference between stated and measured noise, if there is one, and what was left out, if anything was."""
    sentences = [] if (noise := noise_sentence(campaign)) is None else [noise]
    left_out = [f"{r.file.name}: {r.sentence}" for r in campaign.remarks if r.severity is Severity.ERROR]
    if left_out:
        more = len(left_out) - MAX_LISTED
        quoted = " | ".join(left_out[:MAX_LISTED])
        sentences.append(f"Some data are not used. {quoted}" + (f" | and {more} more remarks." if more > 0 else "."))
    return sentences


def data_as_json(campaign: Campaign) -> dict[str, Any]:
    """The noise of every signal as stated, measured and used (SI), and all remarks on the data."""
    return {"noise": noise_as_json(campaign), "remarks": [str(remark) for remark in campaign.remarks]}
