"""The pictures of a diagnosis: the missing term over its variable, the parameters before and after."""


import numpy as np

from edhas_jax.diagnosis import Diagnosis
from edhas_jax.figures import COLOURS, INK, QUIET
from edhas_jax.fit_figures import BELIEVED
from edhas_jax.missing_term import MissingTerm
from edhas_jax.sensor_fault import SensorFault
from edhas_jax.signals import SIGNALS
from edhas_jax.slots import Rule
from edhas_jax.units import from_si, shown_unit, with_error

BINS = 60


def draw_missing_term(term: MissingTerm):
    """A matplotlib figure: points estimated without a law and the accepted law, over the variable of the term."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    about = SIGNALS[term.axis]
    factor = term.slot.rule is Rule.SCALE
    unit = "" if factor else shown_unit(term.slot.unit, float(np.abs(term.law).max()))

    def across(values):
        return from_si(values, about.unit, about.shown)

    def up(values):
        return values if factor else from_si(values, term.slot.unit, unit)

    at, law = _line(term.path, term.law)
    axes.plot(across(term.path), up(term.law), ".", ms=1.5, color=COLOURS[1], alpha=0.25)
    formula = getattr(term.suspect.kind, "text", None)
    told = f"accepted law: {term.suspect.name}" if formula is None else f"formula: c · {formula}"
    axes.plot(across(at), up(law), color=COLOURS[1], lw=1.6, label=told)
    axes.errorbar(across(term.at), up(term.value), yerr=1.96 * np.abs(up(term.std) - up(0.0 * term.std)), fmt="o", ms=5,
                  color=COLOURS[0], capsize=3, elinewidth=1.4, label="estimated without a law, 95 %")  # fmt: skip
    axes.axhline(1.0 if factor else 0.0, color=QUIET, lw=0.8)
    axes.set_xlabel(f"{term.axis.replace('_', ' ')}, {about.shown}", fontsize=9, color=INK)
    what = term.slot.name.replace("_", " ")
    axes.set_ylabel(f"{what}{'' if factor else f', {unit}'}", fontsize=9, color=INK)
    _finish(figure, axes)
    return figure


def draw_sensor_fault(fault: SensorFault):
    """A matplotlib figure: what a sensor reads too much, measured and as the accepted fault says."""
    from matplotlib.figure import Figure

    about = SIGNALS[fault.suspect.signal]
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    zero = from_si(0.0, about.unit, about.shown)
    at, value, law, std = (
        from_si(v, about.unit, about.shown) - zero for v in (fault.at, fault.value, fault.law, fault.std)
    )
    axes.plot(at if fault.over_rate else at + zero, law, color=COLOURS[1], lw=1.6,
              label=f"accepted fault: {fault.suspect.name}")  # fmt: skip
    axes.errorbar(at if fault.over_rate else at + zero, value, yerr=1.96 * std, fmt="o", ms=5, color=COLOURS[0],
                  capsize=3, elinewidth=1.4, label="measured − model, mean, 95 %")  # fmt: skip
    axes.axhline(0.0, color=QUIET, lw=0.8)
    name = fault.suspect.signal.replace("_", " ")
    over = f"rate of {name}, {about.shown}/s" if fault.over_rate else f"{name}, {about.shown}"
    axes.set_xlabel(over, fontsize=9, color=INK)
    axes.set_ylabel(f"{name} reads too much, {about.shown}", fontsize=9, color=INK)
    _finish(figure, axes)
    return figure


def _finish(figure, axes) -> None:
    axes.grid(color="#e4e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=QUIET, labelsize=8)
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)


def _line(q: np.ndarray, law: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The mean of a law in bins of equal count over its variable."""
    parts = np.array_split(np.argsort(q), min(BINS, len(q)))
    return np.array([q[p].mean() for p in parts]), np.array([law[p].mean() for p in parts])


def draw_pulls(diagnosis: Diagnosis):
    """A matplotlib figure: each uncertain parameter in standard deviations of what was believed, before and after."""
    from matplotlib.figure import Figure

    final, null = diagnosis.final, diagnosis.calibrated.fit
    known = [k for k, u in enumerate(final.problem.unknowns) if u.name in null.values]
    first = {u.name: (x, s) for u, x, s in zip(null.problem.unknowns, null.x, null.std, strict=True)}
    figure = Figure(figsize=(8.6, 1.3 + 0.36 * len(known)), layout="constrained")
    axes = figure.subplots()
    axes.axvspan(-2, 2, color=BELIEVED, lw=0, alpha=0.5)
    axes.axvspan(-1, 1, color=BELIEVED, lw=0)
    rows = np.arange(len(known))[::-1]
    names, most = [], 3.0
    for row, k in zip(rows, known, strict=True):
        u, x, std = final.problem.unknowns[k], final.x[k], final.std[k]
        before, spread = first[u.name]
        axes.errorbar(before, row + 0.14, xerr=1.96 * spread, fmt="o", mfc="white", ms=5, color="#9a6700", capsize=2)
        axes.errorbar(x, row - 0.14, xerr=1.96 * std, fmt="o", ms=5, color=COLOURS[1], capsize=2)
        names.append(f"{u.name.replace('_', ' ')}   {with_error(final.values[u.name], final.errors[u.name], u.unit)}")
        most = max(most, abs(before) + 1.96 * spread, abs(x) + 1.96 * std)
    axes.set_xlim(-1.1 * most, 1.1 * most)
    axes.set_yticks(rows, names, fontsize=9, color=INK)
    axes.set_xlabel("distance from what was believed, in its standard deviations (grey: ±1, ±2)", fontsize=9, color=INK)
    legend = "○ calibrated without the effect   ● with what was accepted   (95 %)"
    axes.set_title(legend, fontsize=9, loc="left", color=INK)
    axes.grid(True, axis="x", color="#d8dee4", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="x", colors=QUIET, labelsize=8)
    return figure
