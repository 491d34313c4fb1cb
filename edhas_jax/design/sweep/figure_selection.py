"""What the pictures of a sweep share: the designs that are shown, labels in engineering units, titles."""

import dataclasses
import textwrap
from collections.abc import Sequence

import numpy as np

from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, format_number, format_quantity, to_si
from edhas_jax.design.sweep.table import NOT_RUN, SweepResult

INK, QUIET, GRID, FAILED = "#1b1f24", "#6e7781", "#d8dee4", "#d0d7de"
COLOURS = "viridis"
WIDEST = 85  # characters in a line of a title
DEFAULT_METRICS = ("mean_flow", "overall_efficiency", "amplitude_ratio")
NEAR = 0.05  # share of a parameter's range that a slice of sampled designs is wide to either side


class FigureError(ValueError):
    """A picture cannot be drawn; `missing` when the result lacks what this kind of picture needs."""

    def __init__(self, what: str, missing: bool = False):
        super().__init__(what)
        self.missing = missing


@dataclasses.dataclass
class View:
    """A result and which of its designs are shown."""

    result: SweepResult
    chosen: np.ndarray
    sliced: dict[str, str]

    @property
    def is_grid(self) -> bool:
        """Whether the designs are every combination of the values of each parameter."""
        return self.result.manifest["sweep"]["kind"] == "grid"

    @property
    def ok(self) -> np.ndarray:
        """The designs that are shown and whose metrics can be trusted."""
        return self.chosen & (self.result.frame["status"] == "ok").to_numpy()

    @property
    def failed(self) -> np.ndarray:
        """The designs that are shown and have failed."""
        return self.chosen & ~self.result.frame["status"].isin(["ok", NOT_RUN]).to_numpy()

    def values(self, name: str) -> np.ndarray:
        """A column of all designs, in the unit it is shown in."""
        return self.result.shown(name)

    def label(self, name: str) -> str:
        """A column with its unit, as an axis is labelled."""
        shown = self.result.fields[name][1]
        return name.replace("_", " ") + ("" if shown in ("-", "") else f", {shown}")

    def is_log(self, name: str) -> bool:
        """Whether a parameter was spread in equal ratios."""
        axes = self.result.manifest["sweep"]["parameters"]
        return isinstance(axes, dict) and axes.get(name, {}).get("spacing") == "log"

    def varied(self) -> list[str]:
        """The parameters that take more than one value among the designs shown, without those that are sliced."""
        free = [n for n in self.result.parameters if n not in self.sliced]
        return [n for n in free if len(np.unique(self.values(n)[self.chosen])) > 1]

    def quantity(self, name: str, value: float) -> str:
        """A value (SI) of a column as text."""
        return format_quantity(value, self.result.fields[name][0])

    def title(self, what: str, failed: str = "grey") -> str:
        """The title of a picture: what it shows, of how many designs, how many `failed` and how, and how they look."""
        result, frame = self.result, self.result.frame
        status = frame["status"][self.chosen]
        counts = status[~status.isin(["ok", NOT_RUN])].value_counts()
        shown = int(self.chosen.sum())
        told = [f"{shown:,} designs" if shown == len(frame) else f"{shown:,} of {len(frame):,} designs"]
        if result.done < len(frame):
            told.append(f"unfinished, {result.done:,} run")
        reasons = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in counts.items())
        told.append(f"{counts.sum():,} failed ({reasons}), {failed}" if len(counts) else "none failed")
        name = f"{result.manifest['name']}: " if result.manifest.get("name") else ""
        at = "".join(f", {n.replace('_', ' ')} {v}" for n, v in self.sliced.items())
        return f"{textwrap.fill(what + at, WIDEST)}\n{name}{'; '.join(told)}"


def view(result: SweepResult, slices: Sequence[str] = ()) -> View:
    """The designs of a result that lie in slices such as "frequency=20 Hz".

    Raises:
        FigureError: nothing was run yet, or a slice names no parameter or no quantity.
    """
    if not result.done or not result.metrics:
        raise FigureError("no design has been run yet; there is nothing to draw")
    chosen, sliced = np.ones(len(result.frame), bool), {}
    grid = result.manifest["sweep"]["kind"] == "grid"
    for text in slices:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not value:
            raise FigureError(f"--slice {text}: write NAME=VALUE, for example frequency=20Hz")
        one_of(name, result.parameters, f"--slice {text}: no parameter of this sweep")
        column, unit = result.frame[name].to_numpy(), result.fields[name][0]
        try:
            wanted = to_si(value, unit, format_quantity(column[0], unit))
        except UnitError as error:
            raise FigureError(f"--slice {text}: {error}") from None
        if not column.min() * (1 - 1e-9) <= wanted <= column.max() * (1 + 1e-9):
            span = f"{format_quantity(column.min(), unit)} … {format_quantity(column.max(), unit)}"
            raise FigureError(f"--slice {text}: outside what was swept, {span}")
        if grid:
            at = column[np.argmin(np.abs(column - wanted))]
            chosen &= column == at
            sliced[name] = format_quantity(at, unit)
        else:
            width = NEAR * (column.max() - column.min())
            chosen &= np.abs(column - wanted) <= width
            sliced[name] = f"{format_quantity(wanted, unit)} ± {format_quantity(width, unit)}"
    if not chosen.any():
        raise FigureError("no design lies in all these slices")
    return View(result, chosen, sliced)


def one_of(name: str, valid: Sequence[str], what: str) -> str:
    """The name, if it is one of the valid ones.

    Raises:
        FigureError: it is not.
    """
    if name not in valid:
        raise FigureError(f"{what} `{name}`; {suggest(name, valid)}")
    return name


def metric_of(result: SweepResult, name: str | None) -> str:
    """The metric that is asked for, or the one that matters most among those there are."""
    if name is not None:
        return one_of(name, result.metrics, "no metric")
    return next((n for n in DEFAULT_METRICS if n in result.metrics), result.metrics[0])


def tick(value: float) -> str:
    """A number on an axis."""
    return format_number(value, 3)
