"""From what size an effect would be seen in runs that need not have been made."""

import dataclasses
import math

import numpy as np

from edhas_jax.campaign import Campaign
from edhas_jax.signals import SIGNALS
from edhas_jax.signature_products import Look
from edhas_jax.suspects import Suspect, unknowns_of
from edhas_jax.units import format_quantity
from edhas_jax.unknown import Law, Unknown

SEEN = math.sqrt(30.0)  # length in noise from which a signature stands out among forty suspects
LADDER = {Law.FACTOR: (-2.0, -1.0, 0.0, 1.0, 2.0), Law.SHIFT: (0.02, 0.1, 0.4, 1.0, 2.0)}
FURTHEST = 100.0  # times the strongest that was simulated: nothing is said beyond


@dataclasses.dataclass(frozen=True)
class Visible:
    """From what size a suspect would be seen.

    Its first parameter, `unknown`, is taken as its size: the effect is `absent` at that value (SI; inf where it fades
    as the parameter grows) and seen from `size` on, NaN where even the strongest plausible effect stays unseen.
    `share` is the smallest strength that is seen over the strongest plausible one, above 1 extrapolated. `x` are the
    coordinates, of those simulated, nearest to the threshold and above it, or the strongest ones.
    """

    suspect: Suspect
    unknown: Unknown | None
    absent: float
    size: float
    share: float
    x: np.ndarray

    @property
    def seen(self) -> bool:
        """Whether it is seen within its plausible range."""
        return self.share <= 1.0

    @property
    def parameter(self) -> str:
        """The name of the parameter that is its size."""
        return "" if self.unknown is None else self.unknown.name.removeprefix(self.suspect.prefix)

    def threshold(self) -> str:
        """The size from which it is seen, as text with its unit."""
        if self.unknown is None or not math.isfinite(self.size):
            return ""
        if math.isinf(self.absent):
            return f"≤ {format_quantity(float(f'{self.size:.2g}'), self.unit)}"
        away = format_quantity(float(f"{self.size - self.absent:.2g}"), self.unit)
        return f"≥ {away}" if self.absent == 0.0 else f"± {away} of {format_quantity(self.absent, self.unit)}"

    def plausible(self) -> str:
        """The plausible range of the parameter, as text with units."""
        if self.unknown is None:
            return ""
        return " … ".join(format_quantity(float(f"{self.unknown.value(x):.2g}"), self.unit) for x in (-2.0, 2.0))

    @property
    def unit(self) -> str:
        """The SI unit of the parameter; an offset has that of its signal."""
        offset = self.suspect.signal is not None and self.parameter == "offset"
        return SIGNALS[self.suspect.signal].unit if offset else self.unknown.unit


def ladder(unknowns: list[Unknown]) -> np.ndarray:
    """Coordinates (points, n) from weak to strong along the first parameter, the others as they typically are."""
    if not unknowns:
        return np.zeros((1, 0))
    rows = np.zeros((len(LADDER[unknowns[0].law]), len(unknowns)))
    rows[:, 0] = LADDER[unknowns[0].law]
    return rows


def visible_from(look: Look, length: np.ndarray, campaign: Campaign) -> Visible:
    """Where along its ladder a suspect becomes visible; `length` (points,) of its signatures, NaN where one failed."""
    unknowns = unknowns_of(look.suspect, campaign)
    if not unknowns:
        share = SEEN / length[0] if length[0] > 0.0 else math.inf
        return Visible(look.suspect, None, 0.0, math.nan, float(share), look.points[0])
    u = unknowns[0]
    values = np.asarray(u.value(look.points[:, 0]))
    absent = _absent(u, values, length)
    fades = math.isinf(absent)
    ok = np.isfinite(length) & (length > 0.0) & (fades | (values > absent))
    if ok.sum() < 2:
        return Visible(look.suspect, u, 0.0, math.nan, math.inf, look.points[0])
    strength = -np.log(values) if fades else np.log(np.where(ok, values - absent, 1.0))
    order = np.flatnonzero(ok)[np.argsort(strength[ok])]
    at, seen = strength[order], np.log(np.maximum.accumulate(length[order]))
    wanted = math.log(SEEN)
    if wanted < seen[0]:  # weaker than what was simulated: a small effect goes with its size
        threshold = at[0] - (seen[0] - wanted)
    elif wanted > seen[-1]:
        threshold = at[-1] + (wanted - seen[-1])
    else:
        threshold = float(np.interp(wanted, seen, at))
    share = math.exp(threshold - at[-1]) if threshold - at[-1] < math.log(FURTHEST) else math.inf
    above = order[np.searchsorted(at, threshold)] if share < 1.0 else order[-1]
    if share > 1.0:
        return Visible(look.suspect, u, absent, math.nan, share, look.points[above])
    size = math.exp(-threshold) if fades else math.exp(threshold) + absent
    return Visible(look.suspect, u, absent, size, share, look.points[above])


def _absent(u: Unknown, values: np.ndarray, length: np.ndarray) -> float:
    """The value at which an effect is absent; infinite where it fades as the value grows."""
    if u.law is Law.SHIFT:
        return u.centre
    known = length[np.isfinite(length)]
    if len(known) > 2 and known.argmin() not in (0, len(known) - 1):  # absent inside the range, such as a gain of 1
        return 0.5 * float(values[0] + values[-1])
    return math.inf if len(known) and known[-1] < known[0] else 0.0
