"""An unknown of a fit: what is believed of a number before the measurements are looked at."""

import dataclasses
import enum
import math

import numpy as np

from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign

REACH = 4.0  # prior standard deviations


class Law(enum.Enum):
    """How a number is spread around its centre."""

    FACTOR = "factor"  # value = centre · exp(spread · x): sizes, which cannot change sign
    SHIFT = "shift"  # value = centre + spread · x: what may have either sign


@dataclasses.dataclass(frozen=True)
class Unknown:
    """A parameter (SI) to be found, in a coordinate x that is standard normal before anything was measured.

    Without a `prior` the spread only scales the search. `span` bounds the value in any case; with a prior it is sought
    within `REACH` standard deviations, so that a model that lacks something is not bent beyond all belief to hide it.
    """

    name: str
    centre: float
    spread: float
    unit: str
    span: tuple[float, float]
    law: Law = Law.FACTOR
    prior: bool = True

    def value(self, x):
        """The value (SI) at coordinate x."""
        return self.centre * np.exp(self.spread * x) if self.law is Law.FACTOR else self.centre + self.spread * x

    def slope(self, x):
        """d value/dx."""
        return self.spread * (self.value(x) if self.law is Law.FACTOR else np.ones_like(x))

    def coordinate(self, value: float) -> float:
        """The coordinate x of a value."""
        if self.law is Law.SHIFT:
            return (value - self.centre) / self.spread
        return math.log(value / self.centre) / self.spread if value > 0.0 else -math.inf

    def bounds(self) -> tuple[float, float]:
        """Where it is sought, as coordinates."""
        low, high = (self.coordinate(value) for value in self.span)
        return (max(low, -REACH), min(high, REACH)) if self.prior else (low, high)


def uncertain_unknowns(campaign: Campaign, machine: Rig | None = None) -> tuple[Unknown, ...]:
    """The uncertain parameters of a campaign that a machine has, each a factor on what is known of it."""
    machine = campaign.machine if machine is None else machine
    return tuple(unknown_of(machine, name, spread) for name, spread in campaign.uncertain_in(machine).items())


def unknown_of(machine: Rig, name: str, spread: float) -> Unknown:
    """A parameter of a machine, spread by the relative standard deviation `spread` around its present value."""
    p, _ = find_parameter(machine, name)
    return Unknown(name, float(get_parameter(machine, name)), spread, p.unit, p.span)
