"""Find patterns in the residuals of a comparison: offset, gain, delay, steps, proportions, regions of the stroke.

Each signal is treated by matching pursuit: of all candidate shapes, the one that explains most of the sum of squares is
subtracted, and the search repeated. Every pattern is ranked by what it explains and described in one sentence about the
model: "outlet pressure: the model is 3 % too high" means that the measured pressure is lower.
"""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from edhas_jax.core.units import format_number, format_quantity
from edhas_jax.machine.interface.signals import Signal
from edhas_jax.measurements.comparison import Comparison, RunComparison

MIN_SHARE = 0.15  # share of the excess over the noise that a pattern must explain
MAX_PATTERNS_PER_SIGNAL = 3
NEGLIGIBLE_RESIDUAL = 1.15  # residual over noise below which a signal is not searched for patterns
STEP_WIDTH = 0.03  # width of a smoothed step, as a share of the range of the quantity that changes sign
MIN_GROWTH = 1.6  # ratio of the sizes of a pattern in the runs above and below the median of a condition
MAX_RELATIVE_ERROR = 0.9  # of the model's signal, above which the measured signal counts as not following it
MIN_STROKE_CYCLES = 0.2  # duration of a stroke, in cycles, below which a change of direction is noise
DISPLAY_NAMES = {"reference": "set point"}


@dataclasses.dataclass(frozen=True)
class Pattern:
    """A pattern that the residuals of one signal follow.

    Args:
        signal: name of the signal.
        axis: the quantity that explains the pattern: a signal name, "phase" or "time".
        share: share of the excess of χ² over the noise that this pattern explains beyond those found before it.
        weight: the explained χ² itself, in units of the squared noise; inf where the simulation failed.
        sentence: a description in plain words.
        stated: the error of the model that the sentence states, SI, (samples,) of each run that has the signal; empty
            without a simple pattern.
    """

    signal: str
    axis: str
    share: float
    weight: float
    sentence: str
    stated: tuple[np.ndarray, ...] = ()


@dataclasses.dataclass(frozen=True)
class _Shape:
    """A candidate: the quantity that explains it, its values (samples,) by run, and the template of its sentence."""

    axis: str
    values: list[np.ndarray]
    sentence: str  # with fields such as {size}, the error of the model for one unit of the shape


def find_patterns(comparison: Comparison) -> list[Pattern]:
    """Find the patterns in the residuals of all signals.

    Args:
        comparison: the model compared with the measurements.

    Returns:
        The patterns, the largest `weight` first; none where all residuals are at the level of the noise.
    """
    patterns = [pattern for signal in comparison.signals for pattern in _patterns_of_signal(comparison, signal)]
    return sorted(patterns, key=lambda pattern: -pattern.weight)


def _patterns_of_signal(comparison: Comparison, signal: str) -> list[Pattern]:
    about = comparison.machine.signals
    runs = [compared for compared in comparison.runs if signal in compared.residuals]
    residuals = [compared.residuals[signal] for compared in runs]
    if not all(np.isfinite(compared.model[signal]).all() for compared in runs):
        sentence = f"{_display_name(signal)}: the model fails before the end of some run"
        return [Pattern(signal, "phase", 1.0, math.inf, sentence)]
    measured = [np.isfinite(values) for values in residuals]
    # error of the model, by how much it is too high, in standard deviations of the noise
    remaining = np.concatenate([-values[ok] for values, ok in zip(residuals, measured, strict=True)])
    count, excess = len(remaining), float(remaining @ remaining) - len(remaining)
    if excess < (NEGLIGIBLE_RESIDUAL**2 - 1.0) * count:
        return []
    shapes = _candidate_shapes(about, runs, signal)
    columns = [np.concatenate([v[ok] for v, ok in zip(shape.values, measured, strict=True)]) for shape in shapes]
    run_of_sample = np.concatenate([np.full(ok.sum(), k) for k, ok in enumerate(measured)])
    noise = comparison.campaign.channels[signal].noise
    span = max(float(np.ptp(compared.model[signal])) for compared in runs)
    patterns: list[Pattern] = []
    for _ in range(MAX_PATTERNS_PER_SIGNAL):
        powers = [float(column @ column) for column in columns]
        explained = [float(remaining @ c) ** 2 / p if p > 0.0 else 0.0 for c, p in zip(columns, powers, strict=True)]
        largest = max(explained)
        if largest == 0.0 or largest < MIN_SHARE * excess:
            break
        best = explained.index(largest)
        column, shape = columns[best], shapes[best]
        size = float(remaining @ column) / float(column @ column)
        sentence = _sentence(about, shape, signal, size * noise, span)
        sentence += _trend_clause(runs, remaining, column, run_of_sample)
        stated = tuple(size * noise * values for values in shape.values)
        patterns.append(Pattern(signal, shape.axis, largest / excess, largest, sentence, stated))
        remaining = remaining - size * column
    if not patterns:
        size = _quantity(about[signal], noise * math.sqrt(excess / count))
        sentence = f"{_display_name(signal)}: the model is wrong by {size} (rms) without a simple pattern"
        patterns.append(Pattern(signal, "phase", 1.0, excess, sentence))
    return patterns


def _candidate_shapes(about: Mapping[str, Signal], runs: list[RunComparison], signal: str) -> list[_Shape]:
    """Offset, gain and delay of the signal, functions of every other signal, and regions of the stroke."""
    name = _display_name(signal)
    ones = [np.ones(len(compared.run.time)) for compared in runs]
    shapes = [_Shape("time", ones, f"{name}: the model is {{size}} {{high}} throughout")]
    modelled = [compared.model[signal] for compared in runs]
    middle = float(np.mean(np.concatenate([values[:1] for values in modelled])))
    span = float(max(np.ptp(values) for values in modelled))
    if span > 0.0:
        # a signal of both signs is too large where it is positive and where it is negative
        deviations = [v - middle for v in modelled]
        is_one_sided = min(float(v.min()) for v in deviations) > -0.05 * span
        sentence = f"{name}: the model is {{share}} {'{high}' if is_one_sided else '{large}'} "
        sentence += f"({{size}} over its range of {_quantity(about[signal], span)})"
        shapes.append(_Shape(signal, [v / span for v in deviations], sentence))
    rates = [np.gradient(v, compared.run.time) for v, compared in zip(modelled, runs, strict=True)]
    shapes.append(_Shape("time", [-rate * 1e-3 for rate in rates], f"{name}: the model is {{delay}} {{late}}"))
    for axis in runs[0].model:
        values = [compared.model[axis] for compared in runs]
        largest = max(float(np.abs(v).max()) for v in values)
        if largest <= 0.0 or about[axis].unit == "Pa" or axis == signal:
            continue
        other, at_largest = _display_name(axis), _quantity(about[axis], largest)
        direction = f"where {other} is largest in either direction, and right where it is 0"
        for errors, error in (
            ([np.tanh(v / (STEP_WIDTH * largest)) for v in values],
             f" is {{size}} {{high}} while {other} is positive, and {{size}} {{low}} while it is negative"),
            ([v / largest for v in values],
             f"'s error is proportional to {other}: {{size}} {{high}} at {at_largest}"),
            ([np.square(v / largest) for v in values], f" is {{size}} {{high}} {direction}"),
            ([v * np.abs(v) / largest**2 for v in values],
             f"'s error goes with the square of {other} and has its sign: {{size}} {{high}} at {at_largest}"),
        ):  # fmt: skip
            shapes.append(_Shape(axis, errors, f"{name}: the model{error}"))
    return shapes + _stroke_regions(runs, name)


def _stroke_regions(runs: list[RunComparison], name: str) -> list[_Shape]:
    """The first two and the last two tenths of each stroke, next to the reversals of the piston."""
    if not all(np.isfinite(compared.frequency) and "piston_velocity" in compared.model for compared in runs):
        return []
    shapes = []
    for direction, sign in (("outward (x rising)", 1.0), ("return (x falling)", -1.0)):
        for tenth, words in ((0, "first tenth"), (1, "second tenth"), (8, "ninth tenth"), (9, "last tenth")):
            values = [(_stroke_position(compared, sign) * 10.0 // 1.0 == tenth).astype(float) for compared in runs]
            sentence = f"{name}: the model is {{size}} {{high}} in the {words} of the {direction} stroke"
            shapes.append(_Shape("phase", values, sentence))
    return shapes


def _stroke_position(compared: RunComparison, sign: float) -> np.ndarray:
    """Elapsed share of the duration of each stroke in one direction (samples,), 0 … 1; −1 outside such strokes."""
    moving = np.sign(compared.model["piston_velocity"]) == sign
    position = np.full(len(moving), -1.0)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], moving.astype(int), [0]])))
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        if (last - first) * compared.run.interval * compared.frequency > MIN_STROKE_CYCLES:
            position[first:last] = (np.arange(last - first) + 0.5) / (last - first)
    return position


def _sentence(about: Mapping[str, Signal], shape: _Shape, signal: str, size: float, span: float) -> str:
    """The sentence of a shape for an error of the model `size` of a signal with the range `span`, both in SI."""
    share = size / span if span > 0.0 else 0.0  # of the model; the sentence relates it to the measured signal
    if shape.axis == signal and share > MAX_RELATIVE_ERROR:
        how = "in the opposite direction" if share > 2.0 - MAX_RELATIVE_ERROR else "hardly at all"
        moves = f"where the model moves by {_quantity(about[signal], span)}, the measured signal moves {how}"
        return f"{_display_name(signal)}: {moves}"
    return shape.sentence.format(
        size=_quantity(about[signal], abs(size)),
        share=f"{format_number(100.0 * abs(share / (1.0 - share)), 2)} %" if shape.axis == signal else "",
        high="too high" if size > 0.0 else "too low", low="too low" if size > 0.0 else "too high",
        large="too large" if size > 0.0 else "too small", late="late" if size > 0.0 else "early",
        delay=format_quantity(float(f"{abs(size) * 1e-3:.2g}"), "s"),
    )  # fmt: skip


def _trend_clause(
    runs: list[RunComparison], remaining: np.ndarray, column: np.ndarray, run_of_sample: np.ndarray
) -> str:
    """A clause on the condition of the runs with which the size of a pattern changes most; empty if none does."""
    sizes = np.array([
        float(remaining[part] @ column[part]) / max(float(column[part] @ column[part]), 1e-30)
        for part in (run_of_sample == k for k in range(len(runs)))
    ])  # fmt: skip
    conditions = {n for compared in runs for n in compared.run.conditions}
    largest, clause = MIN_GROWTH, ""
    for name in sorted(conditions):
        values = np.array([compared.run.conditions.get(name, np.nan) for compared in runs])
        levels = np.unique(values[np.isfinite(values)])
        if len(levels) < 2:
            continue
        low, high = (np.abs(np.mean(sizes[side])) for side in (values < np.median(levels), values > np.median(levels)))
        for larger, smaller, verb in ((high, low, "growing"), (low, high, "falling")):
            if smaller > 0.0 and larger / smaller > largest:
                largest, clause = larger / smaller, f", {verb} with {_display_name(name)}"
    return clause


def _display_name(name: str) -> str:
    return DISPLAY_NAMES.get(name, name.replace("_", " "))


def _quantity(about: Signal, size: float) -> str:
    """A size of a signal (SI) with two significant digits and its unit."""
    number, _, unit = format_quantity(size, about.unit).partition(" ")
    return f"{format_number(float(number), 2)} {unit}".rstrip()
