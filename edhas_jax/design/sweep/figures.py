"""Figures of a sweep by kind: heat map, parallel coordinates, Pareto front."""

from collections.abc import Sequence

from edhas_jax.design.sweep.design_selection import choose_metric, require_one_of, select_designs
from edhas_jax.design.sweep.heat_map import CANDIDATES, draw_heat_map, metric_of_two_parameters
from edhas_jax.design.sweep.parallel_coordinates import FURTHER_METRICS, draw_parallel_coordinates
from edhas_jax.design.sweep.pareto_front import ACTUATOR_OBJECTIVES, PUMP_OBJECTIVES, draw_pareto_front
from edhas_jax.design.sweep.table import SweepResult

KINDS = ("heat", "parallel", "pareto")


def metrics_of_figures(
    leading: Sequence[str], metric: str | None = None, objectives: Sequence[str] | None = None
) -> set[str]:
    """The metrics that the figures of a sweep need, of all in the order of `SweepResult.leading`.

    The other arguments are as of `draw_sweep`.
    """
    pairs = (*PUMP_OBJECTIVES, *ACTUATOR_OBJECTIVES) if objectives is None else objectives
    objectives = (text.partition(":")[0] for text in pairs)
    return {metric, *leading[: max(CANDIDATES, FURTHER_METRICS + 1)], *objectives} & set(leading)


def draw_sweep(
    result: SweepResult,
    kind: str,
    metric: str | None = None,
    x: str | None = None,
    y: str | None = None,
    slices: Sequence[str] = (),
    average: bool = False,
    objectives: Sequence[str] | None = None,
):
    """Draw one kind of figure in engineering units; failed designs are grey and counted in the title.

    Args:
        result: the result of a sweep.
        kind: one of `KINDS`.
        metric: shown as colour; by default mean flow, on a heat map the first that depends on two parameters.
        x: horizontal parameter of a heat map.
        y: vertical parameter of a heat map.
        slices: texts such as "frequency=20 Hz" that restrict the designs.
        average: whether further parameters of a grid are averaged in a heat map, instead of shown in panels. Sampled
            designs are always averaged in cells.
        objectives: of a Pareto front, two texts such as "mean_flow:max".

    Returns:
        A matplotlib figure.

    Raises:
        FigureError: a name is unknown, or the result lacks what the figure needs.
    """
    selection = select_designs(result, slices)
    if kind == "heat":
        shown = metric_of_two_parameters(selection) if metric is None else choose_metric(result, metric)
        return draw_heat_map(selection, shown, x, y, average)
    if kind == "parallel":
        return draw_parallel_coordinates(selection, choose_metric(result, metric))
    require_one_of(kind, KINDS, "no kind of figure")
    return draw_pareto_front(selection, objectives)
