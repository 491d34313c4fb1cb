"""Faults of one sensor that an engineer may name, far beyond what benches usually have."""

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from studies.hidden_effects.answers import SENSOR_PLACE, HiddenEffect, Law
from studies.hidden_effects.generators.chains import DrawnLink, Link, Place
from studies.hidden_effects.generators.visibility import VisibilityTest

REFINEMENT = 5  # grid intervals per sample
TRIES = 4  # of a size that is as visible as wanted
NEAR = 1.3  # largest factor by which it may differ


def _lagging(interval, trace, time):
    """A first-order lag, in steady state at the start."""
    pole = np.exp(-interval / time)
    return trace[0] + lfilter([1.0 - pole], [1.0, -pole], trace - trace[0])


def _delayed(interval, trace, time):
    """The same trace later."""
    at = interval * np.arange(len(trace))
    return CubicSpline(at, trace)(np.maximum(at - time, 0.0))


# name of the parameter, and the plausible sizes; those of an offset are relative to the range of the signal
FAULTS = {
    "sensor_lag": ("lag_time", Link("sensor_lag", Place.SIGNAL, _lagging, (2e-5, 5e-3))),
    "sensor_delay": ("delay", Link("sensor_delay", Place.SIGNAL, _delayed, (2e-5, 5e-3))),
    "sensor_gain": ("gain", Link("sensor_gain", Place.SAMPLES, lambda rng, y, noise, g: (1 + g) * y, (4e-3, 0.2))),
    "sensor_offset": ("offset", Link("sensor_offset", Place.SAMPLES, lambda rng, y, noise, o: y + o, (2e-3, 0.1))),
}


def draw_fault(
    test: VisibilityTest, rng: np.random.Generator, visible: float, least: float
) -> tuple[DrawnLink, tuple[HiddenEffect]] | None:
    """Draw a fault of one sensor that is about as visible as wanted.

    Args:
        test: what a change leaves visible.
        rng: the random generator.
        visible: the wanted χ².
        least: the smallest one that is accepted.

    Returns:
        The fault as a link of the sensor chain, and as what is hidden; None where no plausible size is as visible.
    """
    kind, signal = str(rng.choice(list(FAULTS))), str(rng.choice(list(test.plan.channels)))
    parameter, link = FAULTS[kind]
    extent = np.ptp(np.concatenate([run[signal] for run in test.before])) if kind == "sensor_offset" else 1.0
    low, high = (extent * limit for limit in link.plausible)
    sign = float(rng.choice([-1.0, 1.0])) if link.place is Place.SAMPLES else 1.0
    size = sign * np.sqrt(low * high)
    for _ in range(TRIES):
        found = test.visible_after_fit(test.change_to([_with(run, signal, link, size, test) for run in test.before]))
        if max(least, visible / NEAR) < found < NEAR * visible:
            hidden = HiddenEffect(f"{kind} on {signal}", (SENSOR_PLACE,), Law.LIBRARY, {parameter: float(size)}, found)
            return DrawnLink(link, float(size), (signal,)), (hidden,)
        size *= np.sqrt(visible / max(found, 1e-9))
        if not low <= abs(size) <= high:
            return None
    return None


def _with(run: dict[str, np.ndarray], signal: str, link: Link, size: float, test: VisibilityTest):
    """The signals of a run with the fault."""
    y = run[signal]
    if link.place is Place.SAMPLES:
        return run | {signal: link.act(None, y, 0.0, size)}
    step, at = test.runs[0].interval / REFINEMENT, np.arange(REFINEMENT * (len(y) - 1) + 1)
    fine = CubicSpline(REFINEMENT * step * np.arange(len(y)), y)(step * at)
    return run | {signal: link.act(step, fine, size)[::REFINEMENT]}
