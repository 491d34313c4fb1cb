"""Tables of the figures: the paper, our nominal and calibrated machine, and whether the paper determines a figure."""

import dataclasses

import numpy as np
from rich import box
from rich.table import Table
from scipy.stats import qmc, spearmanr

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench
from studies.paper.published_numbers import (
    CALIBRATED_QUANTITIES,
    FIGURES,
    FITTED,
    OPEN_QUANTITIES,
    STATED_ERRORS,
    STEP_VARIANTS,
    with_derived_parameters,
)
from studies.paper.readings import COARSE_FREQUENCIES, all_figures, step_figures

DETERMINED_DEVIATION = 0.05  # a figure is determined if its relative deviation over the draws is below this
TEXT_COLUMNS = ("determined", "moves", "range", "whose", "fixed")  # first words of the columns that hold text
MAX_MISSING_SHARE = 0.05  # and if it exists in all but this share of the draws


@dataclasses.dataclass(frozen=True)
class Spread:
    """The distribution of a figure over machines that differ in all quantities that the paper does not state.

    Attributes:
        low: 5 % quantile.
        high: 95 % quantile.
        deviation: half the distance of the 16 and 84 % quantiles, relative to the median.
        determined: whether `deviation` is below `DETERMINED_DEVIATION`; for a bound, whether 95 % of the draws keep it.
        main_quantity: the quantity with the largest rank correlation.
        rank: that rank correlation.
        missing: share of the draws in which the figure does not exist.
    """

    low: float
    high: float
    deviation: float
    determined: bool
    main_quantity: str
    rank: float
    missing: float


def figure_spreads(bench: PumpBench, system: ActuatorSystem, count: int) -> dict[str, Spread]:
    """The distribution of each figure over `count` machines; open quantities are log-uniform in their ranges."""
    shares = qmc.Sobol(len(OPEN_QUANTITIES), seed=1).random(count)
    chosen = {o.name: o.low * (o.high / o.low) ** shares[:, k] for k, o in enumerate(OPEN_QUANTITIES)}
    table = {n: np.asarray(v) for n, v in with_derived_parameters(chosen).items()}
    found = all_figures(bench, system, table, COARSE_FREQUENCIES)
    return {key: _spread(key, found[key], shares) for key in FIGURES}


def _spread(key: str, values: np.ndarray, shares: np.ndarray) -> Spread:
    figure, there = FIGURES[key], np.isfinite(values)
    levels = (0.05, 0.16, 0.5, 0.84, 0.95)
    low, less, middle, more, high = np.quantile(values[there], levels) if there.any() else np.full(len(levels), np.nan)
    deviation = 0.5 * (more - less) / (figure.size or abs(middle))
    narrow = high <= figure.simulated if figure.bound else deviation < DETERMINED_DEVIATION
    determined = narrow and there.mean() > 1.0 - MAX_MISSING_SHARE
    beyond = np.where(there, values, np.inf)  # a missing figure is a knee above the highest frequency
    ranks = [spearmanr(column, beyond).statistic if there.any() else 0.0 for column in shares.T]
    most = int(np.argmax(np.abs(ranks)))
    lost = float(1.0 - there.mean())
    return Spread(low, high, deviation, bool(determined), OPEN_QUANTITIES[most].name, float(ranks[most]), lost)


def determined(spread: dict[str, Spread]) -> list[str]:
    """The figures that the paper states and its parameters determine, and that were not fitted."""
    return [k for k, figure in FIGURES.items() if spread[k].determined and k not in FITTED and not figure.inferred]


def worst_error(columns: tuple[dict[str, float], ...], keys: list[str]) -> float:
    """The largest error of these figures against the paper's simulation, over both of our machines."""
    return max(abs(FIGURES[k].error(column[k])) for k in keys for column in columns)


def figure_table(nominal: dict[str, float], calibrated: dict[str, float], spread: dict[str, Spread]) -> Table:
    """A row per figure of the paper."""
    table = _table("figure", "paper,\nmeasured", "paper,\nsimulated", "ours,\nnominal", "ours,\ncalibrated",
                   "determined\nby the paper?")  # fmt: skip
    counted = determined(spread)
    for key, figure in FIGURES.items():
        bound = "< " if figure.bound else ""
        verdict = "yes" if key in counted else "no"
        verdict = "no, fitted" if key in FITTED else "not stated" if figure.inferred else verdict
        values = (figure.format_value(v) for v in (figure.measured, figure.simulated, nominal[key], calibrated[key]))
        measured, simulated, *ours = values
        table.add_row(figure.full_title, measured, bound + simulated, *ours, verdict)
    return table


def spread_table(spread: dict[str, Spread]) -> Table:
    """The variation of each figure with the quantities that the paper does not state."""
    table = _table("if all that is not printed varies", "5 %", "95 %", "±", "not reached", "moves most with")
    for key, figure in FIGURES.items():
        s = spread[key]
        wide = f"{100 * s.deviation:.{0 if s.deviation > 0.1 else 1}f} %"
        if figure.bound or s.missing > MAX_MISSING_SHARE:
            wide = "bound" if figure.bound else "–"
        table.add_row(figure.full_title, figure.format_value(s.low), figure.format_value(s.high), wide,
                      f"{100 * s.missing:.0f} %" if s.missing > 0.0 else "",
                      f"{s.main_quantity.replace('_', ' ')} ({s.rank:+.2f})")  # fmt: skip
    return table


def error_table(nominal: dict[str, float], calibrated: dict[str, float]) -> Table:
    """The errors of the paper's model against its experiment as stated and as recalculated, and those of ours."""
    table = _table("model against the paper's experiment", "stated", "from its own\nfigures", "ours,\nnominal",
                   "ours,\ncalibrated")  # fmt: skip
    for key, stated, reference in STATED_ERRORS:
        figure = FIGURES[key]
        size = figure.simulated if reference == "simulated" else figure.measured
        values = figure.simulated, nominal[key], calibrated[key]
        recalculated, *ours = (100 * (v - figure.measured) / size for v in values)
        title = f"{figure.title}, % of the {reference}"
        table.add_row(title, f"{stated:.1f} %", f"{recalculated:+.1f} %", *(f"{v:+.1f} %" for v in ours))
    return table


def parameter_table(chosen: dict[str, float], nominal: dict[str, float]) -> Table:
    """The calibrated quantities."""
    table = _table("set by the calibration", "nominal", "calibrated", "range", "whose range", "fixed by")
    for o in CALIBRATED_QUANTITIES:
        between = f"{format_quantity(o.low, o.unit)} … {format_quantity(o.high, o.unit)}"
        value = chosen[o.name]
        edge = "; at its end" if min(value / o.low, o.high / value) < 1.001 else ""
        table.add_row(o.name.replace("_", " "), format_quantity(nominal[o.name], o.unit),
                      format_quantity(value, o.unit), between + edge, o.source, o.fixed_by)  # fmt: skip
    return table


def step_variant_table(system: ActuatorSystem) -> Table:
    """The response time for other interpretations of the paper's step test."""
    table = _table("15 mm step, calibrated machine", "ours, s", "of the paper's\nsimulation")
    for title, changes, band in STEP_VARIANTS:
        row = {"step_time": 0.0, **changes}
        found = step_figures(system, {n: np.array([v]) for n, v in row.items()}, band)["response"][0]
        response = found - row["step_time"]
        table.add_row(title, f"{response:.4f}", f"{100 * FIGURES['response'].error(response):+.1f} %")
    return table


def _table(first: str, *rest: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for name in rest:
        numeric = not name.startswith(TEXT_COLUMNS)
        table.add_column(name, justify="right" if numeric else "left", no_wrap=numeric)
    return table
