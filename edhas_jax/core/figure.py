"""Figures as this package makes them: matplotlib's, which a notebook draws."""

import io

import matplotlib.figure


class Figure(matplotlib.figure.Figure):
    """A matplotlib figure that a notebook draws where it is the last value of a cell.

    Without `pyplot` the notebook would show one of matplotlib's as its size in pixels.
    """

    def _repr_png_(self) -> bytes:
        picture = io.BytesIO()
        self.savefig(picture, format="png")
        return picture.getvalue()
