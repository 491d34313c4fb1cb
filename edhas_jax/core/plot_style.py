"""Colours and axes that all figures share."""

INK, GREY = "#1b1f24", "#6e7781"  # of text, and of secondary lines and labels
GRID = "#e4e7eb"
# of data series, in this order; apart for people without red or green receptors as well
COLOURS = ("#0b62c4", "#e8590c", "#14a39a", "#6b1f7a", "#4a3a2a")

LONGEST_IN_MS = 10.0  # s, of an axis of time in milliseconds


def time_unit(end: float) -> tuple[float, str]:
    """The factor and the unit in which times up to `end` [s] are drawn."""
    return (1e3, "ms") if end <= LONGEST_IN_MS else (1.0, "s")
