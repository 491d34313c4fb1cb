"""Which command runs a YAML file: by its sections, without reading the rest of it."""

import re

TOP_LEVEL_KEY = re.compile(r"^([a-z_]+) *:", re.MULTILINE)
OF_SENSITIVITY = {"ranges", "local", "metrics", "samples", "trajectories"}  # one of which an analysis has at least


def command_of(text: str) -> str | None:
    """The command that runs a file: "sweep", "size", "sensitivity", or "simulate" for a configuration.

    Args:
        text: its text, or the beginning of it.

    Returns:
        The command; None for a file that none of these runs, such as a campaign.
    """
    keys = set(TOP_LEVEL_KEY.findall(text))
    if "runs" in keys:
        return None
    if "rig" in keys:
        return "simulate"
    if not keys & {"base", "machine"}:
        return None
    if "sweep" in keys:
        return "sweep"
    if "objective" in keys:
        return "size"
    return "sensitivity" if keys & OF_SENSITIVITY else None
