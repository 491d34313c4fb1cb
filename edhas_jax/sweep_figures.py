"""The pictures of a sweep: heat maps, parallel coordinates, Pareto front."""

from collections.abc import Sequence

from edhas_jax.sweep_heat import heat
from edhas_jax.sweep_lines import parallel, pareto
from edhas_jax.sweep_result import SweepResult
from edhas_jax.sweep_view import FigureError, metric_of, one_of, view

KINDS = ("heat", "parallel", "pareto")


def draw(
    result: SweepResult,
    kind: str,
    metric: str | None = None,
    x: str | None = None,
    y: str | None = None,
    slices: Sequence[str] = (),
    average: bool = False,
    objectives: Sequence[str] | None = None,
):
    """A matplotlib figure of one kind, in engineering units; failed designs are grey and counted in the title.

    `metric` is what the colour shows. Heat maps lie over the parameters `x` and `y`; further parameters of a grid are
    small multiples, or averaged with `average`; sampled designs are averaged in cells. `slices` such as
    "frequency=20 Hz" keep only designs there. `objectives` of a Pareto front are such as "mean_flow:max".

    Raises:
        FigureError: a name is unknown, or the result lacks what the picture needs.
    """
    shown = view(result, slices)
    if kind == "heat":
        return heat(shown, metric_of(result, metric), x, y, average)
    if kind == "parallel":
        return parallel(shown, metric_of(result, metric))
    one_of(kind, KINDS, "no picture")
    return pareto(shown, objectives)


__all__ = ["KINDS", "FigureError", "draw"]
