"""Colours and axes that all figures share."""

INK, GREY = "#1b1f24", "#6e7781"  # of text, and of secondary lines and labels
COLOURS = ("#0b62c4", "#d1490c", "#1a7f4b", "#8a3ffc", "#9a6700")  # of data series, distinct in hue and in lightness

LONGEST_IN_MS = 10.0  # s, of an axis of time in milliseconds


def time_unit(end: float) -> tuple[float, str]:
    """The factor and the unit in which times up to `end` [s] are drawn."""
    return (1e3, "ms") if end <= LONGEST_IN_MS else (1.0, "s")
