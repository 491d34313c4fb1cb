"""Unknown parameters of an estimation problem, with their prior distributions and bounds."""

import dataclasses
import enum
import math

import numpy as np

from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign

PRIOR_BOUND = 4.0  # prior standard deviations within which an estimate is searched


class ParameterScale(enum.Enum):
    """How the value of a parameter follows from its coordinate x."""

    LOGARITHMIC = "logarithmic"  # value = centre · exp(spread · x), for parameters that cannot change sign
    LINEAR = "linear"  # value = centre + spread · x, for parameters of either sign, and for those that may be zero
    RECIPROCAL = "reciprocal"  # value = 1/(spread · x), for an effect that is absent where its parameter is infinite


@dataclasses.dataclass(frozen=True)
class UnknownParameter:
    """A parameter to be estimated, written in a coordinate x whose prior is the standard normal distribution.

    Args:
        name: parameter of the machine, or `signal.sensor_model_id.parameter` of an instrument.
        centre: value at x = 0 (SI).
        spread: prior standard deviation: of the logarithm on the logarithmic scale, of 1/value on the reciprocal one,
            else of the value (SI).
        unit: SI unit of the value.
        span: smallest and largest value (SI) that the search may try.
        scale: how the value follows from the coordinate.
        has_prior: whether x = 0 ± 1 is prior knowledge, which also bounds the search to `PRIOR_BOUND`, so that a
            structurally wrong model cannot compensate with implausible values; otherwise the spread only scales x.
    """

    name: str
    centre: float
    spread: float
    unit: str
    span: tuple[float, float]
    scale: ParameterScale = ParameterScale.LOGARITHMIC
    has_prior: bool = True

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


def uncertain_unknowns(campaign: Campaign, machine: Rig | None = None) -> tuple[UnknownParameter, ...]:
    """The uncertain parameters of a campaign that a machine has, as unknowns with a log-normal prior.

    Args:
        campaign: gives the relative standard deviations.
        machine: gives the centres; the campaign's machine by default.
    """
    machine = campaign.machine if machine is None else machine
    return tuple(relative_unknown(machine, name, spread) for name, spread in campaign.uncertain_in(machine).items())


def relative_unknown(machine: Rig, name: str, spread: float) -> UnknownParameter:
    """A parameter of a machine as an unknown with a log-normal prior around its present value.

    The prior of a number of a rig of one's own that can have either sign is normal, with a share of its value as
    standard deviation.

    Args:
        machine: gives the centre.
        name: name of the parameter.
        spread: relative standard deviation of the prior.

    Raises:
        ParameterError: the machine has no such parameter.
    """
    p, _ = find_parameter(machine, name)
    value = float(get_parameter(machine, name))
    if machine.is_own and p.span[0] < 0.0:
        return UnknownParameter(name, value, spread * abs(value), p.unit, p.span, ParameterScale.LINEAR)
    return UnknownParameter(name, value, spread, p.unit, p.span)
