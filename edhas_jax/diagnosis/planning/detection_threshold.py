"""Detection thresholds: the smallest strength from which the signature of an effect exceeds the noise."""

import dataclasses
import math

import numpy as np

from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

DETECTION_NORM = math.sqrt(30.0)  # norm over noise from which a signature is significant among forty candidates
# coordinates of the first parameter at which a candidate is simulated, from weak to strong
STRENGTH_LEVELS = {
    ParameterScale.LOGARITHMIC: (-2.0, -1.0, 0.0, 1.0, 2.0),
    ParameterScale.LINEAR: (0.02, 0.1, 0.4, 1.0, 2.0),
}
MAX_EXTRAPOLATION = 100.0  # times the strongest simulated effect


@dataclasses.dataclass(frozen=True)
class Detectability:
    """The strength from which a candidate would be detected.

    Attributes:
        candidate: the effect or sensor fault.
        unknown: its first parameter, which measures its strength; None for a candidate without parameters.
        absent_value: value (SI) at which the effect vanishes; inf where it fades as the parameter grows.
        threshold: value (SI) from which it is detected; NaN where even the strongest plausible effect is not.
        threshold_share: threshold as a share of the strongest plausible effect; above 1 extrapolated.
        x: the simulated point in coordinates next above the threshold, or the strongest one, shape (n,).
        signal_unit: SI unit of the signal of a sensor fault.
        weakest: value (SI) of the weakest strength that was simulated; a threshold below it is extrapolated.
    """

    candidate: Candidate
    unknown: UnknownParameter | None
    absent_value: float
    threshold: float
    threshold_share: float
    x: np.ndarray
    signal_unit: str = "-"
    weakest: float = math.nan

    @property
    def detectable(self) -> bool:
        """Whether the effect is detected within its plausible range."""
        return self.threshold_share <= 1.0

    @property
    def parameter(self) -> str:
        """The name of the parameter that measures the strength; empty without one."""
        return "" if self.unknown is None else self.unknown.name.removeprefix(self.candidate.prefix)

    def threshold_text(self) -> str:
        """The threshold as text with its unit, or that the weakest simulated strength is above it already.

        Empty if there is no threshold.
        """
        if self.unknown is None or not math.isfinite(self.threshold):
            return ""
        fades, absent = math.isinf(self.absent_value), self.absent_value
        is_beyond = self.weakest < self.threshold if fades else self.weakest > self.threshold
        if is_beyond:
            signs, value = ("above ", "below ", "less than ± "), self.weakest
        else:
            signs, value = ("≤ ", "≥ ", "± "), self.threshold
        if fades:
            return signs[0] + format_quantity(float(f"{value:.2g}"), self.unit)
        distance = format_quantity(float(f"{value - absent:.2g}"), self.unit)
        if absent == 0.0:
            return signs[1] + distance
        return f"{signs[2]}{distance} of {format_quantity(absent, self.unit)}"

    def plausible_text(self) -> str:
        """The plausible range of the parameter, ± 2 prior standard deviations, as text with units."""
        if self.unknown is None:
            return ""
        return " … ".join(format_quantity(float(f"{self.unknown.value(x):.2g}"), self.unit) for x in (-2.0, 2.0))

    @property
    def unit(self) -> str:
        """The SI unit of the parameter."""
        return self.signal_unit if self.candidate.has_unit_of_signal else self.unknown.unit


def strength_points(unknowns: list[UnknownParameter]) -> np.ndarray:
    """Coordinates (points, n) from a weak to a strong first parameter, all other parameters at their prior means."""
    if not unknowns:
        return np.zeros((1, 0))
    levels = STRENGTH_LEVELS[unknowns[0].scale]
    points = np.zeros((len(levels), len(unknowns)))
    points[:, 0] = levels
    return points


def detectability_of(candidate: Candidate, points: np.ndarray, norms: np.ndarray, campaign: Campaign) -> Detectability:
    """Interpolate the strength at which the norm of a candidate's signature reaches `DETECTION_NORM`.

    Args:
        candidate: the effect or sensor fault.
        points: its simulated points in coordinates, shape (points, n), see `strength_points`.
        norms: norms |E| of its signatures in units of noise, shape (points,); NaN where a simulation failed.
        campaign: gives the priors of the candidate's parameters.

    Returns:
        The threshold, interpolated in logarithms of strength and norm.
    """
    unknowns = candidate.unknowns(campaign)
    unit = campaign.machine.signals[candidate.signal].unit if candidate.signal else "-"
    if not unknowns:
        share = DETECTION_NORM / norms[0] if norms[0] > 0.0 else math.inf
        return Detectability(candidate, None, 0.0, math.nan, float(share), points[0], unit)
    u = unknowns[0]
    values = np.asarray(u.value(points[:, 0]))
    absent = _absent_value(u, values, norms)
    fades = math.isinf(absent)
    usable = np.isfinite(norms) & (norms > 0.0) & (fades | (values > absent))
    if usable.sum() < 2:
        return Detectability(candidate, u, 0.0, math.nan, math.inf, points[0], unit)
    log_strength = -np.log(values) if fades else np.log(np.where(usable, values - absent, 1.0))
    order = np.flatnonzero(usable)[np.argsort(log_strength[usable])]
    strengths, log_norms = log_strength[order], np.log(np.maximum.accumulate(norms[order]))
    required = math.log(DETECTION_NORM)
    if required < log_norms[0]:  # below the simulated range the norm is proportional to the strength
        threshold = strengths[0] - (log_norms[0] - required)
    elif required > log_norms[-1]:
        threshold = strengths[-1] + (required - log_norms[-1])
    else:
        threshold = float(np.interp(required, log_norms, strengths))
    excess = threshold - strengths[-1]
    share = math.exp(excess) if excess < math.log(MAX_EXTRAPOLATION) else math.inf
    nearest = order[np.searchsorted(strengths, threshold)] if share < 1.0 else order[-1]
    if share > 1.0:
        return Detectability(candidate, u, absent, math.nan, share, points[nearest], unit)
    value = math.exp(-threshold) if fades else math.exp(threshold) + absent
    return Detectability(candidate, u, absent, value, share, points[nearest], unit, float(values[order[0]]))


def _absent_value(u: UnknownParameter, values: np.ndarray, norms: np.ndarray) -> float:
    """The value at which an effect vanishes; infinite where it fades as the value grows."""
    if u.scale is ParameterScale.LINEAR:
        return u.centre
    finite = norms[np.isfinite(norms)]
    if len(finite) > 2 and finite.argmin() not in (0, len(finite) - 1):  # vanishes inside the range, e.g. a gain of 1
        return 0.5 * float(values[0] + values[-1])
    return math.inf if len(finite) and finite[-1] < finite[0] else 0.0
