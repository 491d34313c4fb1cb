"""Unknown parameters of an estimation problem, with their prior distributions and bounds."""

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence

import numpy as np

from edhas_jax.config.declared_keys import Keys
from edhas_jax.config.document import Entry
from edhas_jax.core.structs import Parameter
from edhas_jax.core.units import UnitError, difference_to_si, exact_quantity, format_quantity
from edhas_jax.machine.parameters import ParameterError, find_parameter, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import BenchRun, Campaign, Spread, Use

PRIOR_BOUND = 4.0  # prior standard deviations within which an estimate is searched
USUAL_SHARE = 0.01  # of the largest value of a parameter: an example of an absolute standard deviation


class ParameterScale(enum.Enum):
    """How the value of a parameter follows from its coordinate x."""

    LOGARITHMIC = "logarithmic"  # value = centre · exp(spread · x), for parameters that cannot change sign
    LINEAR = "linear"  # value = centre + spread · x, for parameters of either sign, and for those that may be zero
    RECIPROCAL = "reciprocal"  # value = 1/(spread · x), for an effect that is absent where its parameter is infinite


@dataclasses.dataclass(frozen=True)
class UnknownParameter:
    """A parameter to be estimated, written in a coordinate x whose prior is the standard normal distribution.

    Args:
        name: parameter of the machine, or `signal.sensor_model_id.parameter` of an instrument; `parameter in run` for
            one that a single run has of its own.
        centre: value at x = 0 (SI).
        spread: prior standard deviation: of the logarithm on the logarithmic scale, of 1/value on the reciprocal one,
            else of the value (SI).
        unit: SI unit of the value.
        span: smallest and largest value (SI) that the search may try.
        scale: how the value follows from the coordinate.
        has_prior: whether x = 0 ± 1 is prior knowledge, which also bounds the search to `PRIOR_BOUND`, so that a
            structurally wrong model cannot compensate with implausible values; otherwise the spread only scales x.
        run: name of the run whose own value it is; empty for one common to all runs.
    """

    name: str
    centre: float
    spread: float
    unit: str
    span: tuple[float, float]
    scale: ParameterScale = ParameterScale.LOGARITHMIC
    has_prior: bool = True
    run: str = ""

    @property
    def parameter(self) -> str:
        """The name without that of the run."""
        return self.name.removesuffix(f" in {self.run}") if self.run else self.name

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the machine that it changes."""
        return (self.parameter,)

    def value(self, x):
        """The value (SI) at coordinate `x`."""
        if self.scale is ParameterScale.LOGARITHMIC:
            with np.errstate(over="ignore"):  # at a bound of a prior that is far too wide
                return self.centre * np.exp(self.spread * x)
        if self.scale is ParameterScale.RECIPROCAL:
            return 1.0 / (self.spread * x)
        return self.centre + self.spread * x

    def derivative(self, x):
        """The derivative of the value (SI) by the coordinate at `x`."""
        if self.scale is ParameterScale.RECIPROCAL:
            return -self.spread * np.square(self.value(x))
        return self.spread * (self.value(x) if self.scale is ParameterScale.LOGARITHMIC else np.ones_like(x))

    def coordinate(self, value: float) -> float:
        """The coordinate of a value (SI); −inf for a value that the logarithmic scale cannot reach."""
        if self.scale is ParameterScale.LINEAR:
            return (value - self.centre) / self.spread
        if self.scale is ParameterScale.RECIPROCAL:
            return 1.0 / (self.spread * value)
        return math.log(value / self.centre) / self.spread if value > 0.0 else -math.inf

    def bounds(self) -> tuple[float, float]:
        """The smallest and the largest coordinate that the search may try."""
        low, high = sorted(self.coordinate(value) for value in self.span)
        return (max(low, -PRIOR_BOUND), min(high, PRIOR_BOUND)) if self.has_prior else (low, high)


@dataclasses.dataclass(frozen=True)
class ShapeCoefficient(UnknownParameter):
    """The coefficient of a shape that several parameters of the machine follow together.

    Args:
        weights: change (SI) of each of these parameters, by name, per unit of the coordinate.
    """

    weights: tuple[tuple[str, float], ...] = ()

    @classmethod
    def of(cls, name: str, weights: Mapping[str, float]) -> "ShapeCoefficient":
        """The coefficient with a name, whose prior is the standard normal distribution."""
        return cls(name, 0.0, 1.0, "-", (-math.inf, math.inf), ParameterScale.LINEAR, weights=tuple(weights.items()))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The parameters of the machine that it changes."""
        return tuple(name for name, _ in self.weights)

    def added_to(self, present: Mapping[str, float], x: float) -> dict[str, float]:
        """The values (SI) of these parameters at coordinate `x`, from those that they have without the shape."""
        return {name: present[name] + slope * x for name, slope in self.weights}


def uncertain_unknowns(campaign: Campaign, machine: Rig | None = None) -> tuple[UnknownParameter, ...]:
    """The uncertain parameters of a campaign that a machine has, as unknowns; those of the fitted runs come last.

    Args:
        campaign: says how well they are known.
        machine: gives the centres of the common ones; the campaign's machine by default.

    Raises:
        ParameterError: a share of 0 is asked for.
    """
    machine = campaign.machine if machine is None else machine
    common = [unknown_around(machine, name, spread) for name, spread in campaign.uncertain_in(machine).items()]
    return (*common, *own_unknowns(campaign, campaign.runs_for(Use.FIT)))


def own_unknowns(campaign: Campaign, runs: Sequence[BenchRun]) -> tuple[UnknownParameter, ...]:
    """The unknowns that single runs have of their own; the parts of a run have them together."""
    found: dict[str, UnknownParameter] = {}
    for run in runs:
        for name, spread in run.uncertain.items():
            u = unknown_around(campaign.machine, name, spread, run.conditions.get(name))
            own = f"{name} in {run.whole}"
            found[own] = dataclasses.replace(u, name=own, run=run.whole)
    return tuple(found.values())


def unknown_around(machine: Rig, name: str, spread: Spread, value: float | None = None) -> UnknownParameter:
    """A parameter of a machine as an unknown with a prior around a value.

    Args:
        machine: has the parameter.
        name: name of the parameter.
        spread: how well the value is known.
        value: the value (SI); that of the machine by default.

    Raises:
        ParameterError: the machine has no such parameter, or a share of 0 is asked for.
    """
    p, _ = find_parameter(machine, name)
    value = float(get_parameter(machine, name)) if value is None else value
    return with_prior(p, name, value, spread)


def with_prior(p: Parameter, name: str, value: float, spread: Spread) -> UnknownParameter:
    """An unknown with a prior around a value.

    The prior is normal for an absolute spread, and for a number that can have either sign; else log-normal.

    Args:
        p: declaration of the parameter.
        name: name of the unknown.
        value: the value (SI).
        spread: how well the value is known.

    Raises:
        ParameterError: a share of 0 is asked for.
    """
    if spread.is_absolute:
        return UnknownParameter(name, value, spread.size, p.unit, p.span, ParameterScale.LINEAR)
    if problem := share_of_nothing(p, value, spread):
        raise ParameterError(f"{name}: {problem}")
    if p.span[0] < 0.0:
        return UnknownParameter(name, value, spread.size * abs(value), p.unit, p.span, ParameterScale.LINEAR)
    return UnknownParameter(name, value, spread.size, p.unit, p.span)


def read_spread(entry: Entry, p: Parameter, value: float | None = None) -> Spread | None:
    """Read how well a parameter is known: `0.1`, `0.005 V`, `{relative: 0.1}` or `{absolute: 0.005 V}`.

    Args:
        entry: the entry.
        p: declaration of the parameter.
        value: its value (SI), where that is known already.

    Returns:
        The spread; None, and a problem, for anything else.
    """
    share, size = "0.1", format_quantity(USUAL_SHARE * (p.default or 1.0), p.unit)
    forms = {"relative": (share, "-"), "absolute": (size, p.unit)}
    if isinstance(entry.value, Mapping):
        Keys.named(*forms).read(entry)
        given = [name for name in forms if name in entry]
        if len(given) != 1:
            return entry.add(f"one of `relative: {share}` and `absolute: {size}` belongs here")
        (kind,), text = given, str(entry[given[0]].value)
    else:
        text = str(entry.value)
        kind = "relative" if p.unit == "-" or _is_share(text) else "absolute"  # "5 °" of an angle is absolute
    example, unit = forms[kind]
    try:
        found = difference_to_si(text, unit, example)
    except UnitError as error:
        return entry.add(f"a standard deviation belongs here, relative ({share}) or with its unit ({size}): {error}")
    if not found > 0.0:
        return entry.add(f"must be above 0, for example {example}; got {text}")
    spread = Spread(found, kind == "absolute")
    if value is not None and (problem := share_of_nothing(p, value, spread)):
        return entry.add(problem)
    return spread


def _is_share(text: str) -> bool:
    try:
        float(text.strip().removesuffix("%"))
    except ValueError:
        return False
    return True


def share_of_nothing(p: Parameter, value: float, spread: Spread) -> str | None:
    """Why a value cannot have such a spread: it is 0, and the spread is relative; None where it can."""
    if spread.is_absolute or value != 0.0:
        return None
    largest = max((abs(end) for end in p.span if math.isfinite(end)), default=1.0)
    size = exact_quantity(float(f"{USUAL_SHARE * largest:.1g}"), p.unit)
    example = f"{{absolute: {size}}}" if p.unit == "-" else size
    return f"the value is 0, of which no share can be taken; write an absolute standard deviation, such as {example}"
