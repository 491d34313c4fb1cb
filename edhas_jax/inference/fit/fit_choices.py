"""What is chosen for a fit: free and fixed parameters with their limits and priors, runs, signals, time windows."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from edhas_jax.core.units import exact_quantity
from edhas_jax.inference.fit.starts import sample_starts
from edhas_jax.machine.parameters import find_parameter, set_parameters
from edhas_jax.measurements.campaign import BenchRun, Campaign, Spread, Use
from edhas_jax.measurements.unknown_parameters import UnknownParameter, uncertain_unknowns


@dataclasses.dataclass(frozen=True)
class ParameterChoice:
    """What is chosen for one parameter; None leaves what the campaign says.

    Attributes:
        free: whether it is estimated.
        value: initial value of the search, or the value of a fixed parameter (SI).
        smallest: lower limit of the search (SI).
        largest: upper limit of the search (SI).
        spread: standard deviation of its prior.
        has_prior: False leaves only the limits; the spread then scales the steps of the search.
    """

    free: bool = True
    value: float | None = None
    smallest: float | None = None
    largest: float | None = None
    spread: Spread | None = None
    has_prior: bool = True


@dataclasses.dataclass(frozen=True)
class FitChoices:
    """What is chosen for a fit; without anything chosen, what the campaign says.

    Attributes:
        parameters: by name of the parameter, or "parameter in run" for one that a run has of its own.
        runs: names of the runs that are fitted, all others are held out; None for those with `use: fit`.
        noise_factors: by signal that is used, a factor on its noise: 2 gives its samples a quarter of their weight in
            χ². None uses all signals as they are.
        windows: by run, first and last time [s] of the samples that are used; all samples of other runs.
    """

    parameters: Mapping[str, ParameterChoice] = dataclasses.field(default_factory=dict)
    runs: tuple[str, ...] | None = None
    noise_factors: Mapping[str, float] | None = None
    windows: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)

    def applied(self, campaign: Campaign) -> Campaign:
        """The campaign with the chosen parameters, runs, signals and windows; the noise is that of the sensors."""
        uncertain = dict(campaign.uncertain)
        values = {}
        for name, choice in self._common(campaign).items():
            if not choice.free:
                uncertain.pop(name, None)
                values |= {} if choice.value is None else {name: choice.value}
            elif choice.spread is not None:
                uncertain[name] = choice.spread
        channels = campaign.channels
        if self.noise_factors is not None:
            channels = {n: channel for n, channel in channels.items() if n in self.noise_factors}
        runs = (self._applied_to_run(run, campaign, channels) for run in campaign.runs)
        return dataclasses.replace(
            campaign, machine=set_parameters(campaign.machine, values), uncertain=uncertain, channels=channels,
            runs=tuple(run for run in runs if run.signals),
            removed=tuple(removal for removal in campaign.removed if removal.signal in channels),
        )  # fmt: skip

    def weighted(self, campaign: Campaign) -> Campaign:
        """A campaign with the chosen factors on the noise of its signals."""
        if not self.noise_factors or all(factor == 1.0 for factor in self.noise_factors.values()):
            return campaign
        channels = {
            n: dataclasses.replace(channel, noise=self.noise_factors[n] * channel.noise)
            for n, channel in campaign.channels.items()
        }
        return dataclasses.replace(campaign, channels=channels)

    def unknowns(self, campaign: Campaign) -> tuple[UnknownParameter, ...]:
        """The free parameters of the campaign that `applied` gives, with the chosen limits."""
        return tuple(self._limited(u) for u in uncertain_unknowns(campaign))

    def starts(self, unknowns: tuple[UnknownParameter, ...], count: int) -> np.ndarray:
        """Starting points in coordinates (count, n): the first has the initial values, the others are drawn."""
        points = sample_starts(unknowns, count, seed=0)
        for k, u in enumerate(unknowns):
            value = self.parameters.get(u.name, ParameterChoice()).value
            if value is not None and count:
                points[0, k] = u.coordinate(value)
        return points

    def sentences(self, campaign: Campaign) -> list[str]:
        """What differs from what the campaign says, in words."""
        units = _units(self, campaign)
        fixed = {name: choice for name, choice in self.parameters.items() if not choice.free}
        at = (n if c.value is None else f"{n} at {exact_quantity(c.value, units[n])}" for n, c in fixed.items())
        found = [f"Fixed by choice: {', '.join(at)}."] if fixed else []
        if self.runs is not None:
            found.append(f"Fitted by choice to {', '.join(self.runs)} alone; all other runs are held out.")
        if self.noise_factors is not None:
            missing = [n for n in campaign.channels if n not in self.noise_factors]
            found += [f"Not used by choice: {', '.join(missing)}."] if missing else []
            factors = {n: f for n, f in self.noise_factors.items() if f != 1.0}
            listed = ", ".join(f"{n} {factor:g}" for n, factor in factors.items())
            found += (
                [f"Factors on the noise by choice, which change the weights of signals: {listed}."] if factors else []
            )
        for run, (first, last) in self.windows.items():
            found.append(f"Of {run} only {first:g} to {last:g} s is used, by choice.")
        return found

    def as_mapping(self, campaign: Campaign) -> dict[str, Any]:
        """The choices as plain data with units, as `read_choices` takes them."""
        units = _units(self, campaign)
        parameters = {name: _parameter_as_mapping(c, units[name]) for name, c in self.parameters.items()}
        windows = {run: [f"{time:.12g} s" for time in window] for run, window in self.windows.items()}
        rows = {
            "parameters": parameters or None, "runs": None if self.runs is None else list(self.runs),
            "signals": None if self.noise_factors is None else dict(self.noise_factors), "windows": windows or None,
        }  # fmt: skip
        return {key: row for key, row in rows.items() if row is not None}

    def _common(self, campaign: Campaign) -> dict[str, ParameterChoice]:
        """The choices for parameters that all runs share."""
        own = {f"{name} in {run.whole}" for run in campaign.runs for name in run.uncertain}
        return {name: choice for name, choice in self.parameters.items() if name not in own}

    def _applied_to_run(self, run: BenchRun, campaign: Campaign, channels: Mapping) -> BenchRun:
        uncertain, conditions = dict(run.uncertain), dict(run.conditions)
        for name in run.uncertain:
            choice = self.parameters.get(f"{name} in {run.whole}", ParameterChoice())
            if not choice.free:
                del uncertain[name]
                conditions |= {} if choice.value is None else {name: choice.value}
            elif choice.spread is not None:
                uncertain[name] = choice.spread
        signals = {n: values for n, values in run.signals.items() if n in channels}
        if run.name in self.windows:
            first, last = self.windows[run.name]
            is_used = (run.time >= first) & (run.time <= last)
            signals = {n: np.where(is_used, values, np.nan) for n, values in signals.items()}
        use = run.use
        if self.runs is not None:
            use = Use.FIT if run.name in self.runs else Use.HOLDOUT
        return dataclasses.replace(run, uncertain=uncertain, conditions=conditions, signals=signals, use=use)

    def _limited(self, u: UnknownParameter) -> UnknownParameter:
        choice = self.parameters.get(u.name, ParameterChoice())
        low = u.span[0] if choice.smallest is None else choice.smallest
        high = u.span[1] if choice.largest is None else choice.largest
        return dataclasses.replace(u, span=(low, high), has_prior=u.has_prior and choice.has_prior)


def _units(choices: FitChoices, campaign: Campaign) -> dict[str, str]:
    """The SI units of the parameters of which something is chosen."""
    return {name: find_parameter(campaign.machine, name.partition(" in ")[0])[0].unit for name in choices.parameters}


def _parameter_as_mapping(choice: ParameterChoice, unit: str) -> dict[str, Any]:
    numbers = {"value": choice.value, "min": choice.smallest, "max": choice.largest}
    row: dict[str, Any] = {} if choice.free else {"free": False}
    row |= {key: exact_quantity(number, unit) for key, number in numbers.items() if number is not None}
    if not choice.has_prior:
        row["prior"] = "none"
    elif choice.spread is not None:
        kind = "absolute" if choice.spread.is_absolute else "relative"
        row["prior"] = {kind: exact_quantity(choice.spread.size, unit if choice.spread.is_absolute else "-")}
    return row
