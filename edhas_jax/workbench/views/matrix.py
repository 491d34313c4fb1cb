"""The matrix of errors: runs × signals, coloured as in the reports."""

from collections.abc import Callable, Mapping, Sequence

from nicegui import ui

from edhas_jax.measurements.residual_matrix import error_text
from edhas_jax.workbench.figures import error_colour
from edhas_jax.workbench.views.table import cell

WORSE = 1.05  # factor on a residual over noise; that of a few hundred samples scatters by less from model to model


def error_matrix(
    matrix: Mapping[str, Mapping[str, float]], signals: Sequence[str], notes: Mapping[str, str],
    on_click: Callable | None = None, before: Mapping[str, Mapping[str, float]] | None = None, is_small: bool = False,
) -> None:  # fmt: skip
    """Build the matrix.

    Args:
        matrix: residual over noise by run and signal.
        signals: the columns.
        notes: conditions of each run.
        on_click: called with run and signal of a cell.
        before: errors of the model before; cells that have become worse are marked.
        is_small: whether it is one of several: without the errors before, the conditions only where one points.
    """
    kind = "wb-matrix wb-small" if is_small else "wb-matrix"
    with ui.element("div").classes("wb-scroll"), ui.element("table").classes(kind).props("data-mark=matrix"):
        with ui.element("thead"), ui.element("tr"):
            for name in ("run", *signals, *([] if is_small else ["conditions"])):
                cell(name.replace("_", " "), tag="th").parent_slot.parent.props("scope=col")
        with ui.element("tbody"):
            for run, row in matrix.items():
                with ui.element("tr"):
                    with ui.element("th").props("scope=row") as head:
                        ui.label(run)
                        if is_small and notes.get(run):
                            head.tooltip(notes[run])
                    for signal in signals:
                        old = (before or {}).get(run, {}).get(signal)
                        _cell(run, signal, row.get(signal), on_click, old, is_small)
                    if not is_small:
                        cell(notes.get(run, ""), "note wb-quiet")


def matrix_rows(matrices: Mapping[str, Mapping[str, Mapping[str, float]]]) -> list[tuple]:
    """The matrices of several models as a table with its head."""
    rows = [
        (model, run, signal, value)
        for model, matrix in matrices.items() for run, row in matrix.items() for signal, value in row.items()
    ]  # fmt: skip
    return [("model", "run", "signal", "residual_over_noise"), *rows]


def _cell(
    run: str, signal: str, value: float | None, on_click: Callable | None, before: float | None, is_small: bool
) -> None:
    with ui.element("td").classes("cell"):
        if value is None:
            return
        back, ink = error_colour(value)
        button = ui.element("button").style(f"background: {back}; color: {ink}").props("type=button")
        is_worse = before is not None and not value <= WORSE * before
        button.props["aria-label"] = f"{run}, {signal}: {value:.2f} times the noise" + (
            f", worse than {before:.2f} before" if is_worse else ""
        )
        text = error_text(value) if is_small or before is None else f"{error_text(before)} → {error_text(value)}"
        with button:
            ui.label(f"▲ {text}" if is_worse else text)
        if is_worse:
            button.classes("wb-worse")
        if on_click is not None:
            button.on("click", lambda _: on_click(run, signal))
        else:
            button.props("disabled").style("cursor: default")
