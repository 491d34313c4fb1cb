"""The table: paper, our machine as chosen and as calibrated, and whether the paper's parameters determine a figure."""

import dataclasses

import numpy as np
from rich import box
from rich.table import Table
from scipy.stats import qmc, spearmanr

from edhas_jax.core.units import format_quantity
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench
from studies.paper.published_numbers import ERRORS, FIGURES, FITTED, FREE, OPEN, READINGS, complete
from studies.paper.readings import FEW_FREQUENCIES, of_the_step, readings

NARROW = 0.05  # a figure is determined if its standard deviation over the draws is below this share of it
WORDS = ("determined", "moves", "range", "whose", "fixed")  # how the columns begin that hold no numbers
LOST = 0.05  # and if it exists in all but this share of them


@dataclasses.dataclass(frozen=True)
class Spread:
    """A figure over machines that differ in everything the paper leaves open.

    `low`, `high`: 5 and 95 % of the draws; `deviation`: half of what lies between 16 and 84 %, as a share;
    `determined`: see `NARROW`, for a bound that 95 % keep it; `mover`, `rank`: what it moves with most, and its rank
    correlation; `lost`: the share of draws in which the figure does not exist.
    """

    low: float
    high: float
    deviation: float
    determined: bool
    mover: str
    rank: float
    lost: float


def draw(bench: PumpBench, system: ActuatorSystem, count: int) -> dict[str, Spread]:
    """How far each figure is determined: `count` machines, every open quantity even over its range, logarithmically."""
    shares = qmc.Sobol(len(OPEN), seed=1).random(count)
    chosen = {o.name: o.low * (o.high / o.low) ** shares[:, k] for k, o in enumerate(OPEN)}
    table = {n: np.asarray(v) for n, v in complete(chosen).items()}
    found = readings(bench, system, table, FEW_FREQUENCIES)
    return {key: _spread(key, found[key], shares) for key in FIGURES}


def _spread(key: str, values: np.ndarray, shares: np.ndarray) -> Spread:
    figure, there = FIGURES[key], np.isfinite(values)
    levels = (0.05, 0.16, 0.5, 0.84, 0.95)
    low, less, middle, more, high = np.quantile(values[there], levels) if there.any() else np.full(len(levels), np.nan)
    deviation = 0.5 * (more - less) / (figure.size or abs(middle))
    narrow = high <= figure.simulated if figure.bound else deviation < NARROW
    determined = narrow and there.mean() > 1.0 - LOST
    beyond = np.where(there, values, np.inf)  # of a knee that is not reached: it lies above
    ranks = [spearmanr(column, beyond).statistic if there.any() else 0.0 for column in shares.T]
    most = int(np.argmax(np.abs(ranks)))
    lost = float(1.0 - there.mean())
    return Spread(low, high, deviation, bool(determined), OPEN[most].name, float(ranks[most]), lost)


def determined(spread: dict[str, Spread]) -> list[str]:
    """The figures that the paper states, that its parameters determine, and to which nothing was fitted."""
    return [k for k, figure in FIGURES.items() if spread[k].determined and k not in FITTED and not figure.inferred]


def worst_error(columns: tuple[dict[str, float], ...], keys: list[str]) -> float:
    """The largest error of these figures against the paper's simulation, over both of our machines."""
    return max(abs(FIGURES[k].error(column[k])) for k in keys for column in columns)


def figure_table(nominal: dict[str, float], calibrated: dict[str, float], spread: dict[str, Spread]) -> Table:
    """A row per figure of the paper."""
    table = _empty("figure", "paper,\nmeasured", "paper,\nsimulated", "ours,\nnominal", "ours,\ncalibrated",
                   "determined\nby the paper?")  # fmt: skip
    counted = determined(spread)
    for key, figure in FIGURES.items():
        bound = "< " if figure.bound else ""
        told = "no, fitted" if key in FITTED else "not stated" if figure.inferred else "yes" if key in counted else "no"
        table.add_row(figure.full_title, figure.told(figure.measured), bound + figure.told(figure.simulated),
                      figure.told(nominal[key]), figure.told(calibrated[key]), told)  # fmt: skip
    return table


def spread_table(spread: dict[str, Spread]) -> Table:
    """How far every figure moves with what the paper leaves open."""
    table = _empty("if all that is not printed varies", "5 %", "95 %", "±", "not reached", "moves most with")
    for key, figure in FIGURES.items():
        s = spread[key]
        wide = f"{100 * s.deviation:.{0 if s.deviation > 0.1 else 1}f} %"
        if figure.bound or s.lost > LOST:
            wide = "bound" if figure.bound else "–"
        table.add_row(figure.full_title, figure.told(s.low), figure.told(s.high), wide,
                      f"{100 * s.lost:.0f} %" if s.lost > 0.0 else "",
                      f"{s.mover.replace('_', ' ')} ({s.rank:+.2f})")  # fmt: skip
    return table


def error_table(nominal: dict[str, float], calibrated: dict[str, float]) -> Table:
    """The errors that the paper tells between its model and its experiment, worked out again, and ours."""
    table = _empty("model against the paper's experiment", "told", "from its own\nfigures", "ours,\nnominal",
                   "ours,\ncalibrated")  # fmt: skip
    for key, told, of in ERRORS:
        figure = FIGURES[key]
        size = figure.simulated if of == "simulated" else figure.measured
        again, *ours = (100 * (v - figure.measured) / size for v in (figure.simulated, nominal[key], calibrated[key]))
        title = f"{figure.title}, % of the {of}"
        table.add_row(title, f"{told:.1f} %", f"{again:+.1f} %", *(f"{v:+.1f} %" for v in ours))
    return table


def parameter_table(chosen: dict[str, float], nominal: dict[str, float]) -> Table:
    """What the calibration has set."""
    table = _empty("set by the calibration", "nominal", "calibrated", "range", "whose range", "fixed by")
    for o in FREE:
        between = f"{format_quantity(o.low, o.unit)} … {format_quantity(o.high, o.unit)}"
        value = chosen[o.name]
        edge = "; at its end" if min(value / o.low, o.high / value) < 1.001 else ""
        table.add_row(o.name.replace("_", " "), format_quantity(nominal[o.name], o.unit),
                      format_quantity(value, o.unit), between + edge, o.source, o.fixed_by)  # fmt: skip
    return table


def reading_table(system: ActuatorSystem) -> Table:
    """The response time if the paper's step was run or read in another way than ours."""
    table = _empty("15 mm step, calibrated machine", "ours, s", "of the paper's\nsimulation")
    for title, changes, band in READINGS:
        row = {"step_time": 0.0, **changes}
        found = of_the_step(system, {n: np.array([v]) for n, v in row.items()}, band)["response"][0]
        response = found - row["step_time"]
        table.add_row(title, f"{response:.4f}", f"{100 * FIGURES['response'].error(response):+.1f} %")
    return table


def _empty(first: str, *rest: str) -> Table:
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column(first, no_wrap=True)
    for name in rest:
        numeric = not name.startswith(WORDS)
        table.add_column(name, justify="right" if numeric else "left", no_wrap=numeric)
    return table
