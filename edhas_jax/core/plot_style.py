"""Colours that all figures share."""

INK, GREY = "#1b1f24", "#6e7781"  # of text, and of secondary lines and labels
COLOURS = ("#0b62c4", "#d1490c", "#1a7f4b", "#8a3ffc", "#9a6700")  # of data series, distinct in hue and in lightness
