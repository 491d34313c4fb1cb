"""Metrics: named numbers of a run or of a cycle; one declaration each, for runs, batches, derivatives and views.

A metric names what it takes over time, such as the mean or the largest value of something that the signals of one
instant give, and how its value follows. A batch adds this up in its compiled loop; a single run takes the same from its
samples and from its balances of energy and volume.
"""

import dataclasses
import types
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.one_sided_minmax import one_sided_max
from edhas_jax.core.units import display_unit
from edhas_jax.machine.interface.signals import Signal


def largest(a, b):
    """max(a, b), of numbers in NumPy and in JAX."""
    return one_sided_max(a, b) if _in_jax(a, b) else np.maximum(a, b)


def root(x):
    """√x of a mean of squares, in NumPy, where it may miss zero by rounding, and in JAX."""
    return jnp.sqrt(x) if _in_jax(x) else np.sqrt(np.maximum(x, 0.0))


def angle(y, x):
    """The angle [rad] of the point (x, y), in NumPy and in JAX."""
    return jnp.arctan2(y, x) if _in_jax(y, x) else np.arctan2(y, x)


def _in_jax(*values) -> bool:
    return any(isinstance(value, jax.Array) for value in values)


@dataclasses.dataclass(frozen=True, eq=False)
class Mean:
    """The mean over time.

    Attributes:
        of: function (machine, signals of an instant) -> a number. It may also read `sine` and `cosine` of the cycle.
        rows: the rows of the balances of energy and volume whose sum is its integral; those that a machine has.
    """

    of: Callable[[Any, Any], Any]
    rows: tuple[str, ...] = ()

    start = 0.0

    def add(self, total, value):
        """The total after a step in which `of` was `value`."""
        return total + value

    def end(self, total, share):
        """What is taken from the total of a cycle, each step of which is a `share` of it."""
        return total * share

    def over(self, window, values):
        """What is taken over a window of samples, see `edhas_jax.simulation.metrics.Window`."""
        rows = [window.balances[name] for name in self.rows if name in window.balances]
        return window.mean(values, sum(rows[1:], start=rows[0]) if rows else None)

    def slope(self, window, values, change):
        """The derivative of `over` along a `change` of the values."""
        return window.mean(change)


@dataclasses.dataclass(frozen=True, eq=False)
class Peak:
    """The largest value; attributes as of `Mean`."""

    of: Callable[[Any, Any], Any]

    start = -np.inf

    def add(self, total, value):
        """The total after a step, see `Mean.add`."""
        return one_sided_max(value, total)

    def end(self, total, share):
        """What is taken from the total of a cycle, see `Mean.end`."""
        return total

    def over(self, window, values):
        """What is taken over a window of samples, see `Mean.over`."""
        return values[window.inside].max(axis=0)

    def slope(self, window, values, change):
        """The derivative of `over`, see `Mean.slope`."""
        return np.take_along_axis(change, values.argmax(axis=0)[None], axis=0)[0]


@dataclasses.dataclass(frozen=True, eq=False)
class Final:
    """The last value; attributes as of `Mean`."""

    of: Callable[[Any, Any], Any]

    start = 0.0

    def add(self, total, value):
        """The total after a step, see `Mean.add`."""
        return value

    def end(self, total, share):
        """What is taken from the total of a cycle, see `Mean.end`."""
        return total

    def over(self, window, values):
        """What is taken over a window of samples, see `Mean.over`."""
        return values[window.inside][-1]

    def slope(self, window, values, change):
        """The derivative of `over`, see `Mean.slope`."""
        return change[-1]


@dataclasses.dataclass(frozen=True, eq=False)
class WholeRun:
    """What needs all samples of a run at once; a batch and derivatives do not have it.

    Attributes:
        of: function (machine, signals) -> a number; every signal is an array (samples,), with `time` [s].
    """

    of: Callable[[Any, Any], Any]

    def over(self, window, values):
        """What the samples give."""
        return values


Taken = Mean | Peak | Final | WholeRun


class Metric(NamedTuple):
    """The declaration of a metric; its name is the key or attribute under which it is declared.

    Attributes:
        unit: SI unit.
        display_unit: unit in which it is shown.
        doc: meaning.
        taken: what is taken over time.
        value: function (machine, *what was taken) -> the metric.
        rank: 1 for the metric that comes first where only some are shown; 0: wherever all are.
        defined: function as `value` -> whether a single run has this metric; None: always.
        of_cycle: whether only a machine that is driven by a sine has it.
    """

    unit: str
    display_unit: str
    doc: str
    taken: tuple[Taken, ...]
    value: Callable[..., Any]
    rank: int = 0
    defined: Callable[..., Any] | None = None
    of_cycle: bool = False


def metric(
    unit: str, doc: str, taken: Taken | tuple[Taken, ...], value: Callable[..., Any] = lambda m, x: x, *,
    shown: str = "", rank: int = 0, defined: Callable[..., Any] | None = None, of_cycle: bool = False,
) -> Any:  # fmt: skip
    """Declare a metric.

        power = metric("W", "mean power of the pump", Mean(lambda m, s: s.voltage * s.current))

    Args:
        unit: SI unit.
        doc: meaning.
        taken: what is taken over time, one or several; two metrics that name the same object share its computation.
        value: function (machine, *what was taken) -> the metric; by default what was taken, if it is one.
        shown: unit in which it is shown; the usual one by default.
        rank: see `Metric`, as for the others.
        defined: see `Metric`.
        of_cycle: see `Metric`.

    Returns:
        The declaration, to be assigned to a class attribute of a rig.
    """
    several = taken if isinstance(taken, tuple) else (taken,)
    return Metric(unit, shown or display_unit(unit) or "-", doc, several, value, rank, defined, of_cycle)


SIGNAL_METRICS = {
    "mean": "mean", "rms": "rms value", "smallest": "smallest value", "largest": "largest value", "final": "last value",
}  # fmt: skip


def metrics_of_signals(signals: Mapping[str, Signal]) -> dict[str, Metric]:
    """Mean, rms, smallest, largest and last value of every signal but the time, by names such as `mean_level`."""
    found = {}
    for name, about in signals.items():
        if name == "time":
            continue
        at = lambda m, s, n=name: getattr(s, n)  # noqa: E731
        values = (
            (Mean(at), lambda m, x: x), (Mean(lambda m, s, at=at: at(m, s) ** 2), lambda m, x: root(x)),
            (Peak(lambda m, s, at=at: -at(m, s)), lambda m, x: -x), (Peak(at), lambda m, x: x),
            (Final(at), lambda m, x: x),
        )  # fmt: skip
        for (kind, words), (taken, value) in zip(SIGNAL_METRICS.items(), values, strict=True):
            doc = f"{words} of {name.replace('_', ' ')}, {about.doc}"
            found[f"{kind}_{name}"] = metric(about.unit, doc, taken, value, shown=about.display_unit)
    return found


def metrics_of_run(machine) -> dict[str, Metric]:
    """The metrics that a single run of a machine can have, by name."""
    return {n: about for n, about in machine.metrics.items() if not about.of_cycle or machine.cycle is not None}


def metrics_of_batch(machine) -> dict[str, Metric]:
    """The metrics of a machine that are added up step by step, by name: those of batches and derivatives."""
    whole = WholeRun
    return {n: k for n, k in metrics_of_run(machine).items() if not any(isinstance(a, whole) for a in k.taken)}


def all_taken(metrics: Mapping[str, Metric]) -> dict[str, Taken]:
    """What some metrics take over time, each once, by the metric that names it first and its place there."""
    found: dict[Taken, str] = {}
    for name, about in metrics.items():
        for k, taken in enumerate(about.taken):
            found.setdefault(taken, f"{name} {k}")
    return {key: taken for taken, key in found.items()}


def values_of(metrics: Mapping[str, Metric], machine, found: Mapping[Taken, Any]) -> dict[str, Any]:
    """The metrics of a machine from what was found for all that they take."""
    return {name: about.value(machine, *(found[taken] for taken in about.taken)) for name, about in metrics.items()}


def in_order(names: Iterable[str], rank: Callable[[str], int]) -> list[str]:
    """Metrics in the order in which they are shown: by rank, then those without one as they come."""
    return sorted(names, key=lambda name: rank(name) or np.inf)


class _Reader:
    """Signals of an instant that note which of them are read."""

    def __init__(self):
        self.names: dict[str, None] = {}

    def __getattr__(self, name: str):
        self.names[name] = None
        return np.float64(1.0)


@np.errstate(all="ignore")  # the values mean nothing
def signals_read(machine, several: Collection[Taken]) -> list[str]:
    """The names of the signals that are read at an instant."""
    reader = _Reader()
    for taken in several:
        taken.of(machine, reader)
    return [name for name in reader.names if name not in ("sine", "cosine")]


def instant(signals: Mapping[str, Any], phase) -> types.SimpleNamespace:
    """The signals of an instant, with sine and cosine of the cycle at its `phase` [share of the cycle]."""
    library = jnp if _in_jax(phase) else np
    angle = 2 * library.pi * phase
    return types.SimpleNamespace(**signals, sine=library.sin(angle), cosine=library.cos(angle))
