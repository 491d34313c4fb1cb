"""Checks the stated limits of sensors against what they have measured."""

from collections.abc import Iterator

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.measurements.campaign import Campaign, Remark, Severity
from edhas_jax.measurements.checks.unit_checks import COMMON_UNITS, unit_size

LARGEST_SHARE_BEYOND = 0.5  # of samples outside the limits: noise puts half of those at a limit there


def limits_remarks(campaign: Campaign) -> Iterator[Remark]:
    """A warning for each sensor whose stated limits exclude most of what it has measured."""
    for name, channel in campaign.channels.items():
        values = np.concatenate([run.signals[name] for run in campaign.runs if name in run.signals] or [[]])
        values, (low, high) = values[np.isfinite(values)], channel.limits
        share = np.mean((values < low) | (values > high)) if len(values) else 0.0
        if not share > LARGEST_SHARE_BEYOND:
            continue
        about = campaign.machine.signals[name]
        sizes = {unit: unit_size(unit, about.unit) for unit in COMMON_UNITS.get(about.unit, ())}
        fitting = [u for u, size in sizes.items() if low * size <= values.min() and values.max() <= high * size]
        unit = min(fitting, key=sizes.__getitem__, default=None)
        asked = f"are they in {unit}?" if unit else "are they those of this sensor?"
        ends = " … ".join(format_quantity(end, about.unit) for end in (low, high))
        sentence = f"{name}: {100 * share:.0f} % of the samples lie outside the stated limits {ends}; {asked}"
        yield Remark(Severity.WARNING, campaign.folder / "campaign.yaml", 0, sentence)
