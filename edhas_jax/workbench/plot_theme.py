"""Colours of plots on a light and on a dark page."""

import dataclasses

from edhas_jax.core.plot_style import COLOURS


@dataclasses.dataclass(frozen=True)
class Theme:
    """Colours of plots on a light or a dark page."""

    ink: str
    grey: str
    grid: str
    measured: str
    model: str
    residual: str
    good: str
    band: str
    runs: tuple[str, ...]


LIGHT_RUNS = (*COLOURS, "#bf3989", "#57606a", "#0a7ea4")
DARK_RUNS = ("#6cb6ff", "#ff9a5c", "#4fd1c5", "#c99bea", "#d9c6a5", "#ff8fc7", "#aab4bf", "#8fd14f")
LIGHT = Theme(
    "#1b1f24", "#59636e", "#e4e7eb", COLOURS[0], COLOURS[1], "#6e7781", COLOURS[2], "#c3cad1", LIGHT_RUNS
)  # fmt: skip
DARK = Theme("#e6edf3", "#9aa4af", "#30363d", "#6cb6ff", "#ff9a5c", "#9aa4af", "#57c78b", "#57606a", DARK_RUNS)


def theme(dark: bool) -> Theme:
    """The theme of a page."""
    return DARK if dark else LIGHT
