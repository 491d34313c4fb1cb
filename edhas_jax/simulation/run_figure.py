"""The figure of a run: signals over time, and the energy balance."""

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.chart import add_title, style_axes
from edhas_jax.core.name_suggestion import suggest
from edhas_jax.core.plot_style import COLOURS, GREY, INK, time_unit
from edhas_jax.core.units import format_quantity, from_si
from edhas_jax.machine.rigs import Rig
from edhas_jax.simulation.metrics import metric_window

GROUP_COLOURS = {
    "copper": COLOURS[1], "mechanical": COLOURS[4], "fluid": COLOURS[0], "stored": GREY, "delivered": COLOURS[2]
}  # fmt: skip
SET_POINTS, SET_POINT_COLOUR = ("reference", "target"), "#c3cad1"
BALANCE_HEIGHT = 2.9  # inch
CONDITIONS = ("reference", "target", "load")  # components that say what the machine does, and against what
DETAILS = ("ramp_time",)  # that do not say it
MOST_CONDITIONS = 5
SHOWN_CYCLES = 2
SMALL_SHARE = 5e-3  # share of the input below which rows of the energy balance are summed as "other"

LABELS = {
    "reference": "set point", "piston_position": "piston", "target": "target", "cylinder_position": "cylinder",
    "chamber_pressure_a": "chamber A", "chamber_pressure_b": "chamber B", "outlet_pressure": "outlet",
    "accumulator_pressure": "accumulator", "head_pressure": "head side", "rod_pressure": "rod side",
    "suction_lift_a": "suction A", "delivery_lift_a": "delivery A", "suction_lift_b": "suction B",
    "delivery_lift_b": "delivery B",
}  # fmt: skip


def plot_run(machine: Rig, signals: dict, ledger, names: list[str] | None = None):
    """A matplotlib figure: signals over time in engineering units, and the energy balance.

    A bench with a sine as set point shows its last cycles, any other run is shown whole.

    Args:
        machine: the machine.
        signals: SI arrays (samples,) by name.
        ledger: the table of `Run.ledger`.
        names: signals to draw, each in a panel of its own; None draws the usual ones.

    Raises:
        ValueError: a name is no signal of this run.
    """
    from edhas_jax.core.figure import Figure  # slow to import

    if names is None:
        listed = machine.panels or _panels_by_unit(machine)
        panels = [(title, [n for n in names if n in signals]) for title, names in listed]
        panels = [(title, present) for title, present in panels if present]
    else:
        for name in names:
            if name not in signals or name == "time":
                raise ValueError(f"no signal `{name}` in this run; {suggest(name, signals)}")
        panels = [(name.replace("_", " "), [name]) for name in names]
    has_balance = bool((ledger["group"] == "input").any())
    heights = [1.25] * len(panels) + [BALANCE_HEIGHT] * has_balance
    figure = Figure(figsize=(9.5, 1.2 + sum(heights)), layout="constrained")
    grid = figure.add_gridspec(len(heights), 1, height_ratios=heights)
    inside = signals["time"] >= _first_shown(machine, signals["time"][-1]) - 1e-12
    axes = None
    for row, (title, listed) in enumerate(panels):
        axes = figure.add_subplot(grid[row], sharex=axes)
        _draw_panel(axes, machine, signals, title, listed, inside, last=row == len(panels) - 1)
    if has_balance:
        _draw_energy_balance(figure.add_subplot(grid[len(panels)]), ledger)
    effects = ", ".join(e.id.replace("_", " ") for e in machine.effects) or "no effects"
    title = f"{machine.name.replace('_', ' ')}: {_operating_point(machine)}\nwith {effects}"
    add_title(figure, title)
    return figure


def _operating_point(machine: Rig) -> str:
    """What the machine is told to do and what it works against."""
    parts = []
    for component in (getattr(machine, name) for name in CONDITIONS if hasattr(machine, name)):
        for p in structs.parameters(type(component)):
            value = getattr(component, p.name)
            if p.name not in DETAILS and np.ndim(value) == 0 and float(value) != 0.0:
                parts.append(f"{p.name.replace('_', ' ')} {format_quantity(float(value), p.unit)}")
    return ", ".join(parts[:MOST_CONDITIONS]) or _kind_of_reference(machine)


def _kind_of_reference(machine: Rig) -> str:
    return type(machine.reference).__name__.lower() if hasattr(machine, "reference") else ""


def _panels_by_unit(machine: Rig) -> list[tuple[str, list[str]]]:
    """The signals of a rig that names no panels, those of one unit in one panel, as many as there are colours."""
    by_unit: dict[str, list[str]] = {}
    for name, about in machine.signals.items():
        if name != "time":
            by_unit.setdefault(about.display_unit, []).append(name)
    size = len(COLOURS)
    parts = [names[i : i + size] for names in by_unit.values() for i in range(0, len(names), size)]
    return [(names[0].replace("_", " ") if len(names) == 1 else "", names) for names in parts]


def _first_shown(machine: Rig, end: float) -> float:
    """The time [s] from which a run is drawn."""
    if machine.cycle is not None:
        try:
            first, last = metric_window(machine, end)
        except ValueError:
            return 0.0
        return max(first, last - SHOWN_CYCLES / float(machine.reference.frequency))
    return 0.0


def _draw_panel(axes, machine: Rig, signals: dict, title: str, names: list[str], inside, last: bool) -> None:
    """Draw signals of one unit over time."""
    unit = machine.signals[names[0]].display_unit
    scale, time_name = time_unit(float(signals["time"][-1]))
    colours = iter(COLOURS)
    for name in names[: len(COLOURS)]:
        is_set_point = name in SET_POINTS  # a broad band, which the signal upon it does not hide
        axes.plot(
            scale * signals["time"][inside], from_si(signals[name][inside], machine.signals[name].unit, unit),
            color=SET_POINT_COLOUR if is_set_point else next(colours), lw=5.0 if is_set_point else 1.4,
            label=LABELS.get(name, name.replace("_", " ")),
        )  # fmt: skip
    style_axes(axes, f"time, {time_name}" if last else "", f"{title}\n{unit}".strip())
    axes.tick_params(labelbottom=last)
    if len(names) > 1:
        axes.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _draw_energy_balance(axes, table) -> None:
    """Draw the shares of the electrical input as bars."""
    spent = table[table["group"] != "input"]
    small = spent["share"].abs() < SMALL_SHARE
    rows = sorted(((row.Index, row.group, row.share) for row in spent[~small].itertuples()), key=lambda row: row[2])
    rows.insert(0, ("other", "stored", spent["share"][small].sum()))
    names, groups, shares = zip(*rows, strict=True)
    names = [name.replace("_", " ") for name in names]
    axes.barh(names, [100 * x for x in shares], color=[GROUP_COLOURS[g] for g in groups], height=0.7)
    for y, share in enumerate(shares):
        axes.annotate(f" {100 * share:.1f} %", (100 * max(share, 0.0), y), va="center", fontsize=8, color=INK)
    axes.set_xlim(right=118 * max(0.01, *shares))
    axes.axvline(0.0, color=GREY, lw=0.8)
    total = format_quantity(float(table.loc[table["group"] == "input", "energy"].sum()), "J")
    source = table.index[table["group"] == "input"][0].removesuffix(" input")
    axes.set_title(f"{source} energy: {total}, by use", fontsize=9, loc="left", color=INK)
    axes.set_xlabel("share of the electrical input, %", fontsize=9, color=INK)
    axes.tick_params(colors=INK, labelsize=8)
    axes.spines[["top", "right", "left"]].set_visible(False)
    present = [g for g in GROUP_COLOURS if g in groups]
    handles = [axes.barh([0], [0], color=GROUP_COLOURS[g], label=g) for g in present]
    axes.legend(handles=handles, fontsize=8, frameon=False, loc="lower right")
