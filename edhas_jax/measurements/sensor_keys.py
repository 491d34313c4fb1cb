"""Reads the keys of a signal in `campaign.yaml` that say more of its sensor: its limits, and the error of the model."""

from collections.abc import Mapping
from typing import Any

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.core.units import UnitError, to_si
from edhas_jax.machine.interface.signals import Signal


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
