"""Read the section `accuracy:` of `campaign.yaml`: how exactly trigger, settings and sensors of the bench are known."""

from collections.abc import Callable, Collection, Mapping
from typing import Any

from edhas_jax.config.declared_keys import by_parameter
from edhas_jax.config.document import Entry
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.measurements.accuracy import BenchAccuracy, RecorderClock, SensorAccuracy
from edhas_jax.measurements.campaign import Channel
from edhas_jax.measurements.campaign_keys import CLOCK, sensor_keys


def read_accuracy(
    section: Entry, values: Mapping[str, Any], channels: Mapping[str, Channel], signals: Mapping[str, Signal],
    find: Callable[[str], tuple[Parameter, str]], drives: Collection[str] = (),
) -> BenchAccuracy:  # fmt: skip
    """Complete the section by what only the campaign knows; all sizes are standard deviations.

    Args:
        section: its entry.
        values: what is read of it by its declared keys.
        channels: the measured signals of the campaign.
        signals: the signals of its machine.
        find: gives declaration and name in the conditions of a run of a parameter; raises a ParameterError.
        drives: the recorded drives of the campaign.
    """
    entries = section["settings"].mapping("").values()
    settings = {name: values["settings"][e.key[-1]] for e, _, name in by_parameter(entries, find)}
    sensors: dict[str, SensorAccuracy] = {}
    for name, entry in values["signals"].items():
        if name not in channels:
            entry.add(f"is not measured in this campaign; {suggest(str(name), channels)}")
            continue
        sensors[name] = SensorAccuracy(**sensor_keys(signals[name].unit, f"0.1 {channels[name].unit}").read(entry))
    clocks = _read_clocks(section["clocks"], values["clocks"], (*channels, *drives))
    return BenchAccuracy(values["trigger"], values["recorder_filter"], settings, sensors, clocks, values["clock_error"])


def _read_clocks(
    section: Entry, clocks: Mapping[str, Mapping[str, Any]], recorded: Collection[str]
) -> dict[str, RecorderClock]:
    """Further recorders, `motor: {channels: [speed, current], shift: 0.2 s}`."""
    found, taken = {}, set()
    for name, values in clocks.items():
        entry, names = section[name], values["channels"]
        if not names or "shift" not in entry:
            entry.add(f"channels and shift belong here, for example {CLOCK.example}")
            continue
        for channel in names:
            if channel not in recorded:
                entry["channels"].add(f"{channel} is not recorded; {suggest(str(channel), recorded)}")
            elif channel in taken:
                entry["channels"].add(f"{channel} has two clocks")
            taken.add(channel)
        found[str(name)] = RecorderClock(tuple(names), values["shift"])
    return found
