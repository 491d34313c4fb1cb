"""Reads the keys of a signal in `campaign.yaml` that say more of its sensor: its limits, and the error of the model."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.measurements.campaign import Campaign, Remark, Severity
from edhas_jax.measurements.checks.unit_checks import COMMON_UNITS, unit_size

LARGEST_SHARE_BEYOND = 0.5  # of samples outside the limits: noise puts half of those at a limit there


def read_sensor_keys(
    problems: ProblemList, key: tuple, entry: Mapping[str, Any], about: Signal, size: float
) -> dict[str, Any]:
    """Read `limits: [0 V, 10 V]` and `model_error: 0.1`.

    Args:
        problems: collects what is wrong.
        key: the key of the signal.
        entry: its mapping.
        about: the signal.
        size: of the unit in the files [SI].

    Returns:
        The fields of `Channel` that the entry states, SI.
    """
    found: dict[str, Any] = {}
    if "model_error" in entry:
        try:
            found["model_error"] = float(entry["model_error"]) * size
        except (TypeError, ValueError):
            found["model_error"] = -1.0
        if not 0.0 <= found["model_error"] < float("inf"):
            sentence = "a standard deviation in the unit of the signal belongs here, such as 0.1"
            problems.add((*key, "model_error"), f"{sentence}; got {entry['model_error']}")
    if "limits" in entry:
        ends = entry["limits"]
        try:
            low, high = (to_si(str(end), about.unit, f"1 {about.display_unit}") for end in ends)
        except (UnitError, TypeError, ValueError) as error:
            problems.add((*key, "limits"), f"both ends of the sensor's range belong here, such as [0 V, 10 V]: {error}")
            return found
        if not low < high:
            problems.add((*key, "limits"), "the first end must be below the second")
        found["limits"] = low, high
    return found


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
