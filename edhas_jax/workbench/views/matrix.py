"""The matrix of errors: runs × signals, coloured as in the reports."""

import math
from collections.abc import Callable, Mapping, Sequence

from nicegui import ui

from edhas_jax.workbench.figures import error_colour


def error_matrix(
    matrix: Mapping[str, Mapping[str, float]], signals: Sequence[str], notes: Mapping[str, str],
    on_click: Callable | None = None, before: Mapping[str, Mapping[str, float]] | None = None,
) -> None:  # fmt: skip
    """Build the matrix.

    Args:
        matrix: residual over noise by run and signal.
        signals: the columns.
        notes: conditions of each run.
        on_click: called with run and signal of a cell.
        before: errors of the model before, shown in each cell as well.
    """
    with ui.element("div").classes("wb-scroll"), ui.element("table").classes("wb-matrix").props("data-mark=matrix"):
        with ui.element("thead"), ui.element("tr"):
            for name in ("run", *signals, "conditions"):
                with ui.element("th").props("scope=col"):
                    ui.label(name.replace("_", " "))
        with ui.element("tbody"):
            for run, row in matrix.items():
                with ui.element("tr"):
                    with ui.element("th").props("scope=row"):
                        ui.label(run)
                    for signal in signals:
                        _cell(run, signal, row.get(signal), on_click, (before or {}).get(run, {}).get(signal))
                    with ui.element("td").classes("note wb-quiet"):
                        ui.label(notes.get(run, ""))


def _cell(run: str, signal: str, value: float | None, on_click: Callable | None, before: float | None) -> None:
    with ui.element("td").classes("cell"):
        if value is None:
            return
        back, ink = error_colour(value)
        button = ui.element("button").style(f"background: {back}; color: {ink}").props("type=button")
        button.props["aria-label"] = f"{run}, {signal}: {value:.2f} times the noise"
        with button:
            ui.label(_number(value) if before is None else f"{_number(before)} → {_number(value)}")
        if on_click is not None:
            button.on("click", lambda _: on_click(run, signal))
        else:
            button.props("disabled").style("cursor: default")


def _number(value: float) -> str:
    if not math.isfinite(value):
        return "fails"
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"
