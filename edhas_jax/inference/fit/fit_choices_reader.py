"""Read what is chosen for a fit: a YAML file, or a mapping with the same keys and texts."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.declared_keys import Keys, quantity, size_in
from edhas_jax.config.document import Document, Entry
from edhas_jax.config.yaml_with_lines import yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.inference.fit.fit_choices import FitChoices, ParameterChoice
from edhas_jax.machine.parameters import ParameterError, find_parameter, get_parameter, short_names
from edhas_jax.measurements.campaign import Campaign, CampaignError, Use
from edhas_jax.measurements.unknown_parameters import UnknownParameter, read_spread, uncertain_unknowns

KEYS = Keys.named("parameters", "runs", "signals", "windows")
PARAMETER_KEYS = Keys.named("free", "value", "min", "max", "prior")
TIME = size_in("s", "0.1 s", 0.0)
NO_PRIOR = "none"
NOISE_FACTORS = 1e-3, 1e3  # beyond them a signal counts alone, or not at all
LEAST_SAMPLES = 2  # of a window: with one there is nothing to compare over time


def read_choices(source: FitChoices | Mapping[str, Any] | Path | str | None, campaign: Campaign) -> FitChoices:
    """Read the choices for a fit of a campaign.

    Args:
        source: a YAML file, or a mapping with the same keys and texts; None for no choices.
        campaign: the campaign, its data checked.

    Returns:
        The choices in SI units.

    Raises:
        CampaignError: the file cannot be read, or is wrong (every problem, one line each).
    """
    if source is None or isinstance(source, FitChoices):
        return source or FitChoices()
    document = Document(source, CampaignError, "runs: [run1]")
    reader = _Reader(document.top, campaign)
    document.finish()
    return reader.choices


class _Reader:
    """Reads choices; `choices` is valid only if the file has no problems."""

    def __init__(self, top: Entry, campaign: Campaign):
        self._top, self._campaign = top, campaign
        self._runs = {run.name: run for run in campaign.runs}
        self._unknowns = {u.name: u for u in uncertain_unknowns(campaign)}
        KEYS.read(top)
        self.choices = FitChoices(
            self._read_parameters(), self._read_runs(), self._read_noise_factors(), self._read_windows()
        )
        if not top.problems:
            self._check_as_a_whole()

    def _read_parameters(self) -> dict[str, ParameterChoice]:
        found = {}
        for row in self._top["parameters"].mapping("{coil_resistance: {free: false}}").values():
            if not isinstance(row.value, Mapping):
                row.add(f"a mapping such as `{{free: false}}` belongs here, not {yaml_type(row.value)}")
                continue
            PARAMETER_KEYS.read(row)
            if (declared := self._declared(row)) is None:
                continue
            name, p = declared
            if name in found:
                row.add("given twice")
                continue
            choice = self._read_parameter(row, name, p)
            if choice is not None:
                found[name] = choice
        return found

    def _declared(self, entry: Entry) -> tuple[str, Parameter] | None:
        """The name of a parameter as it is among the unknowns, and its declaration; None, and a problem, for none."""
        name = str(entry.key[-1])
        if name in self._unknowns:
            return name, find_parameter(self._campaign.machine, self._unknowns[name].parameter)[0]
        if " in " in name:
            entry.add(f"no fitted run has a value of its own of that name; {suggest(name, self._unknowns)}")
            return None
        try:
            p, path = find_parameter(self._campaign.machine, name)
        except ParameterError as error:
            entry.add(str(error))
            return None
        return short_names(self._campaign.machine)[path, p.name], p

    def _read_parameter(self, row: Entry, name: str, p: Parameter) -> ParameterChoice | None:
        free = {"true": True, "false": False}.get(str(row.value.get("free", True)).lower())
        if free is None:
            return row["free"].add(f"true or false belongs here, not {row.value['free']}")
        numbers = {n: quantity(p).read(_with_unit(row[n], p.unit)) for n in ("value", "min", "max") if n in row}
        spread, has_prior = None, True
        if str(row["prior"].value) == NO_PRIOR:
            has_prior = False
        elif "prior" in row:
            value = None if " in " in name else float(get_parameter(self._campaign.machine, name))
            spread = read_spread(row["prior"], p, value)
        if not free:
            for n in ("min", "max", "prior"):
                if n in row:
                    row[n].add("means nothing for a parameter that is not free; leave it out")
        elif name not in self._unknowns and spread is None and name not in self._campaign.uncertain:
            row.add("is not under `uncertain` of the campaign, so it needs a prior, such as `prior: 0.1`")
        return ParameterChoice(free, numbers.get("value"), numbers.get("min"), numbers.get("max"), spread, has_prior)

    def _read_runs(self) -> tuple[str, ...] | None:
        entry = self._top["runs"]
        if entry.value is None:
            return None
        if not isinstance(entry.value, list) or not entry.value:
            return entry.add(f"a list of runs to be fitted belongs here, such as `[{next(iter(self._runs))}]`")
        for row in entry.list():
            self._require_run(row, str(row.value))
        return tuple(dict.fromkeys(map(str, entry.value)))

    def _require_run(self, entry: Entry, name: str) -> bool:
        if name in self._runs:
            return True
        entry.add(f"no run {name}; {suggest(name, self._runs)}")
        return False

    def _read_noise_factors(self) -> dict[str, float] | None:
        if self._top["signals"].value is None:
            return None
        found, (low, high) = {}, NOISE_FACTORS
        for name, entry in self._top["signals"].mapping("{current: 1}").items():
            if name not in self._campaign.channels:
                entry.add(f"no signal that can be used; {suggest(str(name), self._campaign.channels)}")
                continue
            try:
                factor = to_si(str(entry.value), "-", "1")
            except UnitError as error:
                entry.add(str(error))
                continue
            if not low <= factor <= high:
                entry.add(f"a factor on the noise from {low:g} to {high:g} belongs here; got {entry.value}")
            found[str(name)] = factor
        if not found:
            self._top["signals"].add("no signal is left to be fitted")
        return found

    def _read_windows(self) -> dict[str, tuple[float, float]]:
        found = {}
        for name, row in self._top["windows"].mapping("{run1: [0.1 s, 0.5 s]}").items():
            if not self._require_run(row, str(name)):
                continue
            if not isinstance(row.value, list | tuple) or len(row.value) != 2:
                row.add(f"first and last time belong here, such as `[0.1 s, 0.5 s]`; got {row.value}")
                continue
            first, last = (TIME.read(_with_unit(time, "s")) for time in row.list())
            if first is None or last is None:
                continue
            time = self._runs[str(name)].time
            if int(((time >= first) & (time <= last)).sum()) < LEAST_SAMPLES:
                record = f"the record is from {format_quantity(time[0], 's')} to {format_quantity(time[-1], 's')}"
                row.add(f"holds no samples; {record}, and the first time comes first")
                continue
            found[str(name)] = first, last
        return found

    def _check_as_a_whole(self) -> None:
        """Check what depends on several choices: limits around values, something to fit."""
        try:
            campaign = self.choices.applied(self._campaign)
        except ParameterError as error:  # a fixed value is not allowed beside the others
            self._top["parameters"].add(str(error))
            return
        fitted = campaign.runs_for(Use.FIT)
        if not any(run.valid_samples for run in fitted):
            self._top.add("no sample is left to be fitted: no run is chosen that has one of the chosen signals")
        unknowns = {u.name: u for u in uncertain_unknowns(campaign)}
        if not unknowns:
            self._top["parameters"].add("no parameter is left free, so there is nothing to fit")
        for name, choice in self.choices.parameters.items():
            if choice.free and name in unknowns:
                self._check_limits(self._top["parameters"][name], unknowns[name], choice)

    def _check_limits(self, entry: Entry, u: UnknownParameter, choice: ParameterChoice) -> None:
        def text(value: float) -> str:
            return format_quantity(value, u.unit)

        if not choice.has_prior:
            u = UnknownParameter(u.name, u.centre, u.spread, u.unit, u.span, u.scale, has_prior=False)
        low, high = sorted(float(u.value(x)) if math.isfinite(x) else math.copysign(math.inf, x) for x in u.bounds())
        for name, value in (("min", choice.smallest), ("max", choice.largest)):
            if value is not None and not low <= value <= high:
                remedy = "" if not u.has_prior else f"; a wider prior, or `prior: {NO_PRIOR}`, allows more"
                entry[name].add(f"must lie from {text(low)} to {text(high)}{remedy}; got {text(value)}")
                return
        low = low if choice.smallest is None else choice.smallest
        high = high if choice.largest is None else choice.largest
        if not low < high:
            entry.add(f"min must be below max; got {text(low)} and {text(high)}")
        elif choice.value is not None and not low <= choice.value <= high:
            entry["value"].add(f"the search goes from {text(low)} to {text(high)}; got {text(choice.value)}")


def _with_unit(entry: Entry, unit: str) -> Entry:
    """A quantity as text with its unit: Python may give a number in SI."""
    is_number = isinstance(entry.value, int | float) and not isinstance(entry.value, bool)
    return Entry(f"{entry.value!r} {unit}", entry.key, entry.problems) if is_number and unit != "-" else entry
