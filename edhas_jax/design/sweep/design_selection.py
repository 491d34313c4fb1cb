"""Selection of the designs that a figure of a sweep shows, with labels in engineering units and a title."""

import dataclasses
import functools
import textwrap
from collections.abc import Sequence

import numpy as np
import pandas as pd

from edhas_jax.core.literal_text import figure_text, one_line
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.units import UnitError, format_number, format_quantity, to_si
from edhas_jax.design.sweep.table import NOT_RUN, SweepResult

GRID_COLOUR, FAILED_COLOUR = "#d8dee4", "#d0d7de"
COLOUR_MAP = "viridis"
TITLE_WIDTH = 85  # characters per line
SLICE_HALF_WIDTH = 0.05  # share of a parameter's range, of a slice through sampled designs


class FigureError(ValueError):
    """A figure cannot be drawn; `missing` if the result lacks what this kind of figure needs."""

    def __init__(self, what: str, missing: bool = False):
        super().__init__(what)
        self.missing = missing


@dataclasses.dataclass
class DesignSelection:
    """The designs of a result that a figure shows.

    Attributes:
        result: the result of a sweep.
        selected: marks the designs, shape (designs,).
        slices: by parameter the text of the value to which the designs are restricted.
    """

    result: SweepResult
    selected: np.ndarray
    slices: dict[str, str]

    @property
    def is_grid(self) -> bool:
        """Whether the designs are every combination of the values of each parameter."""
        return self.result.manifest["sweep"]["kind"] == "grid"

    @functools.cached_property
    def ok(self) -> np.ndarray:
        """Marks the selected designs that were run successfully, shape (designs,)."""
        return self.selected & (self.result.frame["status"] == "ok").to_numpy()

    @functools.cached_property
    def failed(self) -> np.ndarray:
        """Marks the selected designs that have failed, shape (designs,)."""
        return self.selected & ~self.result.frame["status"].isin(["ok", NOT_RUN]).to_numpy()

    def values(self, name: str) -> np.ndarray:
        """A column of all designs in the unit it is shown in, shape (designs,)."""
        return self.result.shown(name)

    def label(self, name: str) -> str:
        """Label of an axis: the name of a column with its unit."""
        shown = self.result.fields[name][1]
        return name.replace("_", " ") + ("" if shown in ("-", "") else f", {shown}")

    def is_log(self, name: str) -> bool:
        """Whether a parameter has logarithmic spacing."""
        axes = self.result.manifest["sweep"]["parameters"]
        return isinstance(axes, dict) and axes.get(name, {}).get("spacing") == "log"

    def varied(self) -> list[str]:
        """The parameters that vary among the selected designs, without those of the slices."""
        names = [n for n in self.result.parameters if n not in self.slices]
        columns = {n: self.values(n)[self.selected] for n in names}
        return [n for n, column in columns.items() if column.min() < column.max()]


    def quantity(self, name: str, value: float) -> str:
        """A value (SI) of a column as text."""
        return format_quantity(value, self.result.fields[name][0])

    def title(self, what: str, failed: str = "grey") -> str:
        """Title of a figure: its content, the number of designs, and the failed ones with their look `failed`."""
        result, frame = self.result, self.result.frame
        status = frame["status"][self.selected]
        counts = status[~status.isin(["ok", NOT_RUN])].value_counts()
        shown = int(self.selected.sum())
        notes = [f"{shown:,} designs" if shown == len(frame) else f"{shown:,} of {len(frame):,} designs"]
        if result.done < len(frame):
            notes.append(f"unfinished, {result.done:,} run")
        reasons = ", ".join(f"{count:,} {name.replace('_', ' ')}" for name, count in counts.items())
        notes.append(f"{counts.sum():,} failed ({reasons}), {failed}" if len(counts) else "none failed")
        name = f"{figure_text(one_line(str(result.manifest['name'])))}: " if result.manifest.get("name") else ""
        at = "".join(f", {n.replace('_', ' ')} {v}" for n, v in self.slices.items())
        return f"{textwrap.fill(what + at, TITLE_WIDTH)}\n{name}{'; '.join(notes)}"


def select_designs(result: SweepResult, slices: Sequence[str] = ()) -> DesignSelection:
    """Select the designs of a result that lie in all slices.

    Args:
        result: the result of a sweep.
        slices: texts such as "frequency=20 Hz". In a grid a slice is the nearest value, among samples a band of
            ± `SLICE_HALF_WIDTH` of the parameter's range.

    Raises:
        FigureError: nothing was run yet, a slice is invalid, or no design lies in all slices.
    """
    if not result.done or not result.metrics:
        raise FigureError("no design has been run yet; there is nothing to draw")
    selected, texts = np.ones(len(result.frame), bool), {}
    grid = result.manifest["sweep"]["kind"] == "grid"
    for text in slices:
        name, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not value:
            raise FigureError(f"--slice {text}: write NAME=VALUE, for example frequency=20Hz")
        require_one_of(name, result.parameters, f"--slice {text}: no parameter of this sweep")
        column, unit = result.frame[name].to_numpy(), result.fields[name][0]
        try:
            wanted = to_si(value, unit, format_quantity(column[0], unit))
        except UnitError as error:
            raise FigureError(f"--slice {text}: {error}") from None
        if not column.min() * (1 - 1e-9) <= wanted <= column.max() * (1 + 1e-9):
            span = f"{format_quantity(column.min(), unit)} … {format_quantity(column.max(), unit)}"
            raise FigureError(f"--slice {text}: outside what was swept, {span}")
        if grid:
            nearest_value = column[np.argmin(np.abs(column - wanted))]
            selected &= column == nearest_value
            texts[name] = format_quantity(nearest_value, unit)
        else:
            width = SLICE_HALF_WIDTH * (column.max() - column.min())
            selected &= np.abs(column - wanted) <= width
            texts[name] = f"{format_quantity(wanted, unit)} ± {format_quantity(width, unit)}"
    if not selected.any():
        raise FigureError("no design lies in all these slices")
    return DesignSelection(result, selected, texts)


def few_levels(values: np.ndarray, most: int) -> np.ndarray | None:
    """The distinct values, ascending; None if there are more than `most`."""
    if len(pd.unique(values[: 100 * most])) > most:  # spares counting those of millions of samples
        return None
    levels = np.sort(pd.unique(values))
    return levels if len(levels) <= most else None


def require_one_of(name: str, valid: Sequence[str], what: str) -> str:
    """Return a name if it is valid.

    Raises:
        FigureError: it is not; the message begins with `what` and names the nearest valid ones.
    """
    if name not in valid:
        raise FigureError(f"{what} `{name}`; {suggest(name, valid)}")
    return name


def choose_metric(result: SweepResult, name: str | None) -> str:
    """The metric with this name, or by default the leading one."""
    return result.leading[0] if name is None else require_one_of(name, result.metrics, "no metric")


def tick_label(value: float) -> str:
    """A number on an axis, with three digits."""
    return format_number(value, 3)
