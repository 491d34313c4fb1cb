"""Where a model fails: the simplest patterns that its residuals follow, ranked, each with a size and a sentence."""

import dataclasses
import math

import numpy as np

from edhas_jax.core.units import format_number, format_quantity
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.measurements.comparison import Comparison, RunComparison

WORTH = 0.15  # share of the excess over the noise that a pattern must explain to be told
MOST = 3  # patterns told of one signal
UNSEEN = 1.15  # residual over noise below which nothing is said of a signal
SHARP = 0.03  # of the range of a quantity: the width of a step at its zero
GROWS = 1.6  # ratio of a pattern's size between the upper and the lower runs that is called growth
NAMES = {"reference": "set point"}


@dataclasses.dataclass(frozen=True)
class Pattern:
    """A pattern that residuals of one signal follow.

    `axis` is the quantity (signal name, or "phase") against which it shows. `share` of the excess of χ² over the noise
    is explained by it beyond the patterns before, in all `weight` units of noise². `sentence` says it in plain words.
    """

    signal: str
    axis: str
    share: float
    weight: float
    sentence: str


@dataclasses.dataclass(frozen=True)
class _Shape:
    """A candidate: its values by run view, the quantity against which it shows, and how it is told."""

    axis: str
    values: list[np.ndarray]
    told: str  # with {size}, the change of the signal that one unit of the shape stands for


def find_patterns(comparison: Comparison) -> list[Pattern]:
    """The patterns in the residuals of all signals, the heaviest first."""
    found = [pattern for signal in comparison.signals for pattern in _patterns_of(comparison, signal)]
    return sorted(found, key=lambda pattern: -pattern.weight)


def _patterns_of(comparison: Comparison, signal: str) -> list[Pattern]:
    views = [view for view in comparison.runs if signal in view.residuals]
    rows = [view.residuals[signal] for view in views]
    if not all(np.isfinite(view.model[signal]).all() for view in views):
        return [Pattern(signal, "phase", 1.0, math.inf, f"the model fails before it gives {_name(signal)} in some run")]
    there = [np.isfinite(row) for row in rows]
    left = np.concatenate([row[ok] for row, ok in zip(rows, there, strict=True)])
    count, excess = len(left), float(left @ left) - len(left)
    if excess < (UNSEEN**2 - 1.0) * count:
        return []
    shapes = _shapes(views, signal)
    stacked = [np.concatenate([v[ok] for v, ok in zip(shape.values, there, strict=True)]) for shape in shapes]
    run_of = np.concatenate([np.full(ok.sum(), k) for k, ok in enumerate(there)])
    noise = comparison.campaign.channels[signal].noise
    out: list[Pattern] = []
    for _ in range(MOST):
        best, gain = None, 0.0
        for k, column in enumerate(stacked):
            power = float(column @ column)
            explained = float(left @ column) ** 2 / power if power > 0.0 else 0.0
            if explained > gain:
                best, gain = k, explained
        if best is None or gain < WORTH * excess:
            break
        column, shape = stacked[best], shapes[best]
        size = float(left @ column) / float(column @ column)
        told = _told(shape, signal, size * noise) + _growth(views, left, column, run_of)
        out.append(Pattern(signal, shape.axis, gain / excess, gain, told))
        left = left - size * column
    return out or [_scattered(signal, left, noise, excess)]


def _shapes(views: list[RunComparison], signal: str) -> list[_Shape]:
    """What is tried: zero, scale, delay, steps and proportions against every quantity, regions of the cycle."""
    name = _name(signal)
    ones = [np.ones(len(view.run.time)) for view in views]
    shapes = [_Shape("time", ones, f"{name} reads {{size}} {{high}} throughout")]
    own = [view.model[signal] for view in views]
    middle = float(np.mean(np.concatenate([values[:1] for values in own])))
    span = max(np.ptp(values) for values in own)
    told = f"{name} is {{large}} in proportion: {{size}} over its whole range of {_span(signal, span)}"
    shapes.append(_Shape(signal, [(v - middle) / span for v in own], told))
    rates = [np.gradient(v, view.run.time) for v, view in zip(own, views, strict=True)]
    shapes.append(_Shape("time", [-rate * 1e-3 for rate in rates], f"{name} is {{late}} by {{delay}}"))
    for axis in views[0].model:
        values = [view.model[axis] for view in views]
        reach = max(float(np.abs(v).max()) for v in values)
        if reach <= 0.0 or SIGNALS[axis].unit == "Pa" or axis == signal:
            continue
        told = f"{name} steps by {{twice}} where {_name(axis)} changes sign ({{high}} while it is positive)"
        shapes.append(_Shape(axis, [np.tanh(v / (SHARP * reach)) for v in values], told))
        told = f"{name} is off in proportion to {_name(axis)}: {{size}} {{high}} at {_span(axis, reach)}"
        shapes.append(_Shape(axis, [v / reach for v in values], told))
        told = f"{name} reads {{size}} {{high}} where {_name(axis)} is largest, either sign, and right where it is 0"
        shapes.append(_Shape(axis, [np.square(v / reach) for v in values], told))
        told = f"{name} is off as the square of {_name(axis)}, with its sign: {{size}} {{high}} at {_span(axis, reach)}"
        shapes.append(_Shape(axis, [v * np.abs(v) / reach**2 for v in values], told))
    return shapes + _regions(views, name)


def _regions(views: list[RunComparison], name: str) -> list[_Shape]:
    """Tenths of each stroke, and the samples just after the piston has turned."""
    if not all(np.isfinite(view.frequency) and "piston_velocity" in view.model for view in views):
        return []
    shapes = []
    for way, sign in (("outward (x rising)", 1.0), ("return (x falling)", -1.0)):
        for tenth, words in ((0, "first tenth"), (1, "second tenth"), (8, "ninth tenth"), (9, "last tenth")):
            values = [(_stroke_share(view, sign) * 10.0 // 1.0 == tenth).astype(float) for view in views]
            shapes.append(_Shape("phase", values, f"{name} reads {{size}} {{high}} in the {words} of the {way} stroke"))
    return shapes


def _stroke_share(view: RunComparison, sign: float) -> np.ndarray:
    """How much of a stroke in this direction is behind, 0 … 1 in time; −1 during the other one."""
    moving = np.sign(view.model["piston_velocity"]) == sign
    out = np.full(len(moving), -1.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if (last - first) * view.run.interval * view.frequency > 0.2:
            out[first:last] = (np.arange(last - first) + 0.5) / (last - first)
    return out


def _told(shape: _Shape, signal: str, size: float) -> str:
    return shape.told.format(
        size=_span(signal, abs(size)), twice=_span(signal, 2.0 * abs(size)), high="high" if size > 0.0 else "low",
        large="too large" if size > 0.0 else "too small", late="late" if size > 0.0 else "early",
        delay=format_quantity(float(f"{abs(size) * 1e-3:.2g}"), "s"),
    )  # fmt: skip


def _growth(views: list[RunComparison], left: np.ndarray, column: np.ndarray, run_of: np.ndarray) -> str:
    """Whether the size of a pattern changes with a condition of the runs, as a clause."""
    sizes = np.array([
        float(left[run_of == k] @ column[run_of == k]) / max(float(column[run_of == k] @ column[run_of == k]), 1e-30)
        for k in range(len(views))
    ])  # fmt: skip
    conditions = {n for view in views for n in view.run.conditions}
    best, word = GROWS, ""
    for name in sorted(conditions):
        values = np.array([view.run.conditions.get(name, np.nan) for view in views])
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) < 2:
            continue
        low, high = (np.abs(np.mean(sizes[side])) for side in (values < np.median(levels), values > np.median(levels)))
        for big, small, verb in ((high, low, "growing"), (low, high, "falling")):
            if small > 0.0 and big / small > best:
                best, word = big / small, f", {verb} with {_name(name)}"
    return word


def _scattered(signal: str, left: np.ndarray, noise: float, excess: float) -> Pattern:
    size = _span(signal, noise * math.sqrt(excess / len(left)))
    return Pattern(signal, "phase", 1.0, excess, f"{_name(signal)} is off by {size} (rms) in no simple pattern")


def _name(name: str) -> str:
    return NAMES.get(name, name.replace("_", " "))


def _span(signal: str, size: float) -> str:
    number, _, unit = format_quantity(size, SIGNALS[signal].unit).partition(" ")
    return f"{format_number(float(number), 2)} {unit}".rstrip()
