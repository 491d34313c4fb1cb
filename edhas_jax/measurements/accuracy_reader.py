"""Read the section `accuracy:` of `campaign.yaml`: how exactly trigger, settings and sensors of the bench are known."""

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
from typing import Any

from edhas_jax.config.problem_list import ProblemList
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, difference_to_si
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.measurements.accuracy import BenchAccuracy, RecorderClock, SensorAccuracy
from edhas_jax.measurements.campaign import Channel

KEYS = ("trigger", "clock_error", "recorder_filter", "settings", "signals", "clocks")
MAX_RELATIVE = 1.0  # a larger relative standard deviation is a mistake in the unit


class AccuracyReader:
    """Reads the section `accuracy:`; what is wrong goes to a list of problems.

    Args:
        problems: collects what is wrong.
        channels: the measured signals of the campaign.
        signals: the signals of its machine.
        drives: the recorded drives of the campaign.
        canonical_name: the name of a parameter as in the conditions of a run, from its key and the name in the file;
            None, and a problem, where the machine has none.
    """

    def __init__(
        self, problems: ProblemList, channels: Mapping[str, Channel], signals: Mapping[str, Signal],
        canonical_name: Callable[[tuple, str], str | None], drives: Collection[str] = (),
    ):  # fmt: skip
        self._problems, self._channels, self._about, self._drives = problems, channels, signals, drives
        self._canonical_name = canonical_name

    def read(self, section: Any) -> BenchAccuracy:
        """Read the section; None is a campaign without it. All sizes are standard deviations."""
        section = self._mapping(("accuracy",), section, "accuracy: {trigger: 0.2 ms}")
        self._problems.add_unknown_keys(("accuracy",), section, KEYS)
        trigger = BenchAccuracy().trigger
        if "trigger" in section:
            trigger = self._size(("accuracy", "trigger"), section["trigger"], "s", "0.2 ms")
        recorder_filter = BenchAccuracy().recorder_filter
        if "recorder_filter" in section:
            recorder_filter = self._size(("accuracy", "recorder_filter"), section["recorder_filter"], "-", "0")
        clock_error = None
        if "clock_error" in section:
            clock_error = self._size(("accuracy", "clock_error"), section["clock_error"], "s", "20 us")
        settings, signals = self._settings(section.get("settings")), self._signals(section.get("signals"))
        clocks = self._clocks(section.get("clocks"))
        return BenchAccuracy(trigger, recorder_filter, settings, signals, clocks, clock_error)

    def _settings(self, section: Any) -> dict[str, float]:
        found: dict[str, float] = {}
        section = self._mapping(("accuracy", "settings"), section, "settings: {load_orifice_area: 0.5 %}")
        for name, value in section.items():
            key = ("accuracy", "settings", name)
            canonical = self._canonical_name(key, str(name))
            if canonical in found:
                self._problems.add(key, f"given twice, also as {canonical}")
            elif canonical is not None:
                found[canonical] = self._share(key, value, "0.5 %")
        return found

    def _signals(self, section: Any) -> dict[str, SensorAccuracy]:
        found: dict[str, SensorAccuracy] = {}
        section = self._mapping(("accuracy", "signals"), section, "signals: {outlet_pressure: {gain: 0.3 %}}")
        for name, value in section.items():
            key = ("accuracy", "signals", name)
            if name not in self._channels:
                self._problems.add(key, f"is not measured in this campaign; {suggest(str(name), self._channels)}")
                continue
            unit, shown = self._about[name].unit, self._channels[name].unit
            readers = {
                "gain": lambda k, v: self._share(k, v, "0.3 %"),
                "offset": lambda k, v, si=unit, example=f"0.1 {shown}": self._size(k, v, si, example),
                "shift": lambda k, v: self._size(k, v, "s", "20 us"),
            }
            entry = self._mapping(key, value, "outlet_pressure: {gain: 0.3 %, offset: 2 kPa, shift: 20 us}")
            self._problems.add_unknown_keys(key, entry, tuple(readers))
            sizes = {n: read((*key, n), entry[n]) for n, read in readers.items() if n in entry}
            found[name] = dataclasses.replace(SensorAccuracy(), **sizes)
        return found

    def _clocks(self, section: Any) -> dict[str, RecorderClock]:
        """Further recorders, `motor: {channels: [speed, current], shift: 0.2 s}`."""
        found: dict[str, RecorderClock] = {}
        example = "{channels: [speed, current], shift: 0.2 s}"
        recorded, taken = (*self._channels, *self._drives), set()
        for name, value in self._mapping(("accuracy", "clocks"), section, f"clocks: {{motor: {example}}}").items():
            key = ("accuracy", "clocks", name)
            entry = self._mapping(key, value, example)
            self._problems.add_unknown_keys(key, entry, ("channels", "shift"))
            names = entry.get("channels")
            if not isinstance(names, list) or not names or "shift" not in entry:
                self._problems.add(key, f"channels and shift belong here, for example {example}")
                continue
            for channel in names:
                if channel not in recorded:
                    nearest = suggest(str(channel), recorded)
                    self._problems.add((*key, "channels"), f"{channel} is not recorded; {nearest}")
                elif channel in taken:
                    self._problems.add((*key, "channels"), f"{channel} has two clocks")
                taken.add(channel)
            shift = self._size((*key, "shift"), entry["shift"], "s", "0.2 s")
            found[str(name)] = RecorderClock(tuple(map(str, names)), shift)
        return found

    def _mapping(self, key: tuple, value: Any, example: str) -> Mapping[str, Any]:
        if value is None or isinstance(value, Mapping):
            return value or {}
        self._problems.add(key, f"a mapping belongs here, for example `{example}`, not {yaml_type(value)}")
        return {}

    def _share(self, key: tuple, value: Any, example: str) -> float:
        """A relative standard deviation, as a number or in per cent."""
        share = self._size(key, value, "-", example)
        if share > MAX_RELATIVE:
            self._problems.add(
                key, f"a relative standard deviation is at most 100 %, for example {example}; got {value}"
            )
        return share

    def _size(self, key: tuple, value: Any, unit: str, example: str) -> float:
        """A standard deviation in SI; 0, and a problem, for anything else."""
        try:
            size = difference_to_si(str(value), unit, example)
        except UnitError as error:
            self._problems.add(key, str(error))
            return 0.0
        if size < 0.0 or not math.isfinite(size):
            self._problems.add(key, f"a standard deviation is 0 or above, for example {example}; got {value}")
            return 0.0
        return size
