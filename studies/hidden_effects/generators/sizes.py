"""Draw the parameters of a hidden law such that it can just be seen, or more easily."""

import dataclasses
import math

import numpy as np

from edhas_jax.core.structs import Parameter, replace
from edhas_jax.machine.rigs import Rig
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.visibility import VisibilityTest

MIN_VISIBLE = 60.0
MAX_DRAWS = 6  # of the shape of a law, until it can be seen
MAX_DRAWS_WANTED = 2  # and until it can be as visible as wanted, before another law is drawn
SIZE_RANGE = 20.0  # largest size that is drawn, over the smallest that can be seen
TRIES, NEAR = 4, 1.3  # of a size that is as visible as wanted, and the largest factor by which it may differ


@dataclasses.dataclass(frozen=True)
class Drawn:
    """A law with its parameters, its change of the signals of the fitted runs, and how much of it is visible."""

    law: Law
    values: dict[str, float]
    machine: Rig
    change: np.ndarray
    visible: float


def mounted(machine: Rig, law: Law, values: dict[str, float]) -> Rig:
    """The machine with a law added."""
    return replace(machine, effects=(*machine.effects, law.kind(**values)))


def draw_value(p: Parameter, rng: np.random.Generator) -> float:
    """A value from the plausible range: log-uniform where that is positive, else uniform."""
    low, high = p.plausible
    if low > 0.0:
        return float(math.exp(rng.uniform(math.log(low), math.log(high))))
    return float(rng.uniform(low, high))


def draw_visible(
    test: VisibilityTest, law: Law, rng: np.random.Generator, at_least: float = MIN_VISIBLE, wanted: float | None = None
) -> Drawn | None:
    """Draw the parameters of a law: shapes within their ranges, the size log-uniformly above the smallest visible one.

    Args:
        test: what a change leaves visible.
        law: the law.
        rng: the random generator.
        at_least: the smallest `visible` that is accepted.
        wanted: the `visible` that the size shall have; None for a size that is drawn.

    Returns:
        The law; None where no plausible size of any drawn shape can be seen, or is about as visible as wanted.
    """
    machine = test.machine
    low, high = sorted(abs(v) for v in law.size.plausible)
    either_sign = law.size.plausible[0] < 0.0
    low = 0.02 * high if either_sign else low
    for _ in range(MAX_DRAWS if wanted is None else MAX_DRAWS_WANTED):
        values = {p.name: draw_value(p, rng) for p in law.free_parameters}
        for p in law.free_parameters:
            if p.at_least and values[p.name] < values.get(p.at_least, 0.0):
                values[p.name] = values[p.at_least] * float(rng.uniform(1.0, 1.8))
        sign = -1.0 if either_sign and rng.uniform() < 0.5 else 1.0
        middle, position = sign * math.sqrt(low * high), rng.uniform()
        found = _evaluated(test, machine, law, values | {law.size.name: middle})
        if not found.visible > 0.0:
            continue
        if wanted is not None:
            found = _as_visible(test, law, found, wanted, sign * low, sign * high)
            if found is not None and found.visible > at_least:
                return found
            continue
        # the change is about in proportion to the size, so `visible` to its square
        ratio = math.sqrt(1.2 * at_least / found.visible)
        if law.falls:
            most = min(high, abs(middle) / ratio)
            least = max(low, most / SIZE_RANGE)
        else:
            least = max(low, abs(middle) * ratio)
            most = min(high, max(least, SIZE_RANGE * abs(middle) * ratio))
        if least > most:
            continue
        size = sign * math.exp(math.log(least) + position * math.log(most / least))
        found = _evaluated(test, machine, law, values | {law.size.name: size})
        if found.visible > at_least:
            found = dataclasses.replace(found, visible=test.visible_after_fit(found.change))
        if found.visible > at_least:
            return found
    return None


def _as_visible(test: VisibilityTest, law: Law, found: Drawn, wanted: float, first: float, last: float) -> Drawn | None:
    """The law of the size that is about as visible as wanted, between a first and a last size; None without one."""
    low, high = sorted((first, last))
    for _ in range(TRIES):
        step = math.sqrt(wanted / found.visible)
        size = found.values[law.size.name] * (1.0 / step if law.falls else step)
        if not low <= size <= high:
            return None
        found = _evaluated(test, test.machine, law, found.values | {law.size.name: size})
        if not found.visible > 0.0:
            return None
        found = dataclasses.replace(found, visible=test.visible_after_fit(found.change))
        if wanted / NEAR < found.visible < NEAR * wanted:
            return found
    return None


def _evaluated(test: VisibilityTest, machine: Rig, law: Law, values: dict[str, float]) -> Drawn:
    changed = mounted(machine, law, values)
    change = test.change(changed)
    visible = test.all.visible(change) if np.isfinite(change).all() else math.nan
    return Drawn(law, values, changed, change, visible)
