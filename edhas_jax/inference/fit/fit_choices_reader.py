"""Read what is chosen for a fit: a YAML file, or a mapping with the same keys and texts."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from edhas_jax.config.problem_list import ProblemList, problem_lines
from edhas_jax.config.yaml_with_lines import YamlError, key_text, line_of, parse_yaml, read_text_file, yaml_type
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, format_quantity, to_si
from edhas_jax.inference.fit.fit_choices import FitChoices, ParameterChoice
from edhas_jax.machine.parameters import ParameterError, find_parameter, get_parameter, short_names
from edhas_jax.measurements.campaign import Campaign, CampaignError, Use
from edhas_jax.measurements.record_timing import read_time
from edhas_jax.measurements.unknown_parameters import UnknownParameter, read_spread, uncertain_unknowns

KEYS = "parameters", "runs", "signals", "windows"
PARAMETER_KEYS = "free", "value", "min", "max", "prior"
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
    if isinstance(source, Mapping):
        reader = _Reader(source, campaign)
        messages = [f"choices: {key_text(key)}: {what}" for key, what in reader.problems]
    else:
        path = Path(source)
        try:
            data, lines, found = parse_yaml(read_text_file(path, CampaignError), "runs: [run1]")
        except YamlError as error:
            raise CampaignError(f"{path}:{error.line}: {error}" if error.line else f"{path}: {error}") from None
        reader = _Reader(data, campaign)
        found += [(line_of(lines, key), f"{key_text(key)}: {what}") for key, what in reader.problems]
        messages = [f"{path}:{line}: {what}" for line, what in sorted(found, key=lambda problem: problem[0])]
    if messages:
        raise CampaignError(problem_lines(messages))
    return reader.choices


class _Reader(ProblemList):
    """Reads choices; `choices` is valid only if `problems` is empty."""

    def __init__(self, data: Mapping[str, Any], campaign: Campaign):
        super().__init__([])
        self._data, self._campaign = data, campaign
        self._runs = {run.name: run for run in campaign.runs}
        self._unknowns = {u.name: u for u in uncertain_unknowns(campaign)}
        self.add_unknown_keys((), data, KEYS)
        self.choices = FitChoices(
            self._read_parameters(), self._read_runs(), self._read_noise_factors(), self._read_windows()
        )
        if not self.problems:
            self._check_as_a_whole()

    def _mapping(self, key: str, example: str) -> Mapping[str, Any]:
        value = self._data.get(key)
        if value is None or isinstance(value, Mapping):
            return value or {}
        self.add((key,), f"a mapping belongs here, for example `{example}`, not {yaml_type(value)}")
        return {}

    def _read_parameters(self) -> dict[str, ParameterChoice]:
        found = {}
        for given, row in self._mapping("parameters", "coil_resistance: {free: false}").items():
            key = ("parameters", str(given))
            if not isinstance(row, Mapping):
                self.add(key, f"a mapping such as `{{free: false}}` belongs here, not {yaml_type(row)}")
                continue
            self.add_unknown_keys(key, row, PARAMETER_KEYS)
            if (declared := self._declared(key)) is None:
                continue
            name, p = declared
            if name in found:
                self.add(key, "given twice")
                continue
            choice = self._read_parameter(key, name, p, row)
            if choice is not None:
                found[name] = choice
        return found

    def _declared(self, key: tuple) -> tuple[str, Parameter] | None:
        """The name of a parameter as it is among the unknowns, and its declaration; None, and a problem, for none."""
        name = key[-1]
        if name in self._unknowns:
            return name, find_parameter(self._campaign.machine, self._unknowns[name].parameter)[0]
        if " in " in name:
            self.add(key, f"no fitted run has a value of its own of that name; {suggest(name, self._unknowns)}")
            return None
        try:
            p, path = find_parameter(self._campaign.machine, name)
        except ParameterError as error:
            self.add(key, str(error))
            return None
        return short_names(self._campaign.machine)[path, p.name], p

    def _read_parameter(self, key: tuple, name: str, p: Parameter, row: Mapping[str, Any]) -> ParameterChoice | None:
        free = row.get("free", True)
        free = {"true": True, "false": False}.get(str(free).lower())
        if free is None:
            self.add((*key, "free"), f"true or false belongs here, not {row['free']}")
            return None
        numbers = {n: self._read_number((*key, n), p, row[n]) for n in ("value", "min", "max") if n in row}
        spread, has_prior = None, True
        if str(row.get("prior")) == NO_PRIOR:
            has_prior = False
        elif "prior" in row:
            value = None if " in " in name else float(get_parameter(self._campaign.machine, name))
            spread = read_spread(self, (*key, "prior"), row["prior"], p, value)
        if not free:
            for n in ("min", "max", "prior"):
                if n in row:
                    self.add((*key, n), "means nothing for a parameter that is not free; leave it out")
        elif name not in self._unknowns and spread is None and name not in self._campaign.uncertain:
            self.add(key, "is not under `uncertain` of the campaign, so it needs a prior, such as `prior: 0.1`")
        return ParameterChoice(free, numbers.get("value"), numbers.get("min"), numbers.get("max"), spread, has_prior)

    def _read_number(self, key: tuple, p: Parameter, value: Any) -> float | None:
        """A text with unit, or from Python a number in SI."""
        return self.read_quantity(key, p, f"{value!r} {p.unit}" if _is_number(value) and p.unit != "-" else value)

    def _read_runs(self) -> tuple[str, ...] | None:
        rows = self._data.get("runs")
        if rows is None:
            return None
        if not isinstance(rows, list) or not rows:
            self.add(("runs",), f"a list of runs to be fitted belongs here, such as `[{next(iter(self._runs))}]`")
            return None
        for k, name in enumerate(rows):
            self._require_run(("runs", k), str(name))
        return tuple(dict.fromkeys(map(str, rows)))

    def _require_run(self, key: tuple, name: str) -> bool:
        if name in self._runs:
            return True
        self.add(key, f"no run {name}; {suggest(name, self._runs)}")
        return False

    def _read_noise_factors(self) -> dict[str, float] | None:
        if self._data.get("signals") is None:
            return None
        found, (low, high) = {}, NOISE_FACTORS
        for name, value in self._mapping("signals", "current: 1").items():
            key = ("signals", str(name))
            if name not in self._campaign.channels:
                self.add(key, f"no signal that can be used; {suggest(str(name), self._campaign.channels)}")
                continue
            try:
                factor = to_si(str(value), "-", "1")
            except UnitError as error:
                self.add(key, str(error))
                continue
            if not low <= factor <= high:
                self.add(key, f"a factor on the noise from {low:g} to {high:g} belongs here; got {value}")
            found[str(name)] = factor
        if not found:
            self.add(("signals",), "no signal is left to be fitted")
        return found

    def _read_windows(self) -> dict[str, tuple[float, float]]:
        found = {}
        for name, row in self._mapping("windows", "run1: [0.1 s, 0.5 s]").items():
            key = ("windows", str(name))
            if not self._require_run(key, str(name)):
                continue
            if not isinstance(row, list | tuple) or len(row) != 2:
                self.add(key, f"first and last time belong here, such as `[0.1 s, 0.5 s]`; got {row}")
                continue
            times = [f"{value!r} s" if _is_number(value) else value for value in row]
            first, last = (read_time(self, (*key, k), value) for k, value in enumerate(times))
            if first is None or last is None:
                continue
            time = self._runs[str(name)].time
            if int(((time >= first) & (time <= last)).sum()) < LEAST_SAMPLES:
                record = f"the record is from {format_quantity(time[0], 's')} to {format_quantity(time[-1], 's')}"
                self.add(key, f"holds no samples; {record}, and the first time comes first")
                continue
            found[str(name)] = first, last
        return found

    def _check_as_a_whole(self) -> None:
        """Check what depends on several choices: limits around values, something to fit."""
        try:
            campaign = self.choices.applied(self._campaign)
        except ParameterError as error:  # a fixed value is not allowed beside the others
            self.add(("parameters",), str(error))
            return
        fitted = campaign.runs_for(Use.FIT)
        if not any(run.valid_samples for run in fitted):
            self.add((), "no sample is left to be fitted: no run is chosen that has one of the chosen signals")
        unknowns = {u.name: u for u in uncertain_unknowns(campaign)}
        if not unknowns:
            self.add(("parameters",), "no parameter is left free, so there is nothing to fit")
        for name, choice in self.choices.parameters.items():
            if choice.free and name in unknowns:
                self._check_limits(("parameters", name), unknowns[name], choice)

    def _check_limits(self, key: tuple, u: UnknownParameter, choice: ParameterChoice) -> None:
        def text(value: float) -> str:
            return format_quantity(value, u.unit)

        if not choice.has_prior:
            u = UnknownParameter(u.name, u.centre, u.spread, u.unit, u.span, u.scale, has_prior=False)
        low, high = sorted(float(u.value(x)) if math.isfinite(x) else math.copysign(math.inf, x) for x in u.bounds())
        for name, value in (("min", choice.smallest), ("max", choice.largest)):
            if value is not None and not low <= value <= high:
                remedy = "" if not u.has_prior else f"; a wider prior, or `prior: {NO_PRIOR}`, allows more"
                self.add((*key, name), f"must lie from {text(low)} to {text(high)}{remedy}; got {text(value)}")
                return
        low = low if choice.smallest is None else choice.smallest
        high = high if choice.largest is None else choice.largest
        if not low < high:
            self.add(key, f"min must be below max; got {text(low)} and {text(high)}")
        elif choice.value is not None and not low <= choice.value <= high:
            self.add((*key, "value"), f"the search goes from {text(low)} to {text(high)}; got {text(choice.value)}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
