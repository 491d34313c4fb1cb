"""The pictures of a diagnosis: the missing term over its variable, the parameters before and after."""



import numpy as np

from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import display_unit, format_with_error, from_si
from edhas_jax.diagnosis.calibration.figures import PRIOR_COLOUR
from edhas_jax.diagnosis.report.nonparametric_term import MissingTerm
from edhas_jax.diagnosis.report.sensor_fault import SensorFault
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.interface.slots import Rule
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import OVERALL, rms_by_signal

BINS = 60


def draw_missing_term(term: MissingTerm):
    """A matplotlib figure: points estimated without a law and the accepted law, over the variable of the term."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    about = SIGNALS[term.axis]
    factor = term.slot.rule is Rule.SCALE
    unit = "" if factor else display_unit(term.slot.unit, float(np.abs(term.law).max()))

    def across(values):
        return from_si(values, about.unit, about.display_unit)

    def up(values):
        return values if factor else from_si(values, term.slot.unit, unit)

    at, law = _line(term.path, term.law)
    axes.plot(across(term.path), up(term.law), ".", ms=1.5, color=COLOURS[1], alpha=0.25)
    formula = getattr(term.suspect.kind, "text", None)
    told = f"accepted law: {term.suspect.name}" if formula is None else f"formula: c · {formula}"
    axes.plot(across(at), up(law), color=COLOURS[1], lw=1.6, label=told)
    axes.errorbar(across(term.at), up(term.value), yerr=1.96 * np.abs(up(term.std) - up(0.0 * term.std)), fmt="o", ms=5,
                  color=COLOURS[0], capsize=3, elinewidth=1.4, label="estimated without a law, 95 %")  # fmt: skip
    axes.axhline(1.0 if factor else 0.0, color=GREY, lw=0.8)
    axes.set_xlabel(f"{term.axis.replace('_', ' ')}, {about.display_unit}", fontsize=9, color=INK)
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
    zero = from_si(0.0, about.unit, about.display_unit)
    at, value, law, std = (
        from_si(v, about.unit, about.display_unit) - zero for v in (fault.at, fault.value, fault.law, fault.std)
    )
    axes.plot(at if fault.over_rate else at + zero, law, color=COLOURS[1], lw=1.6,
              label=f"accepted fault: {fault.suspect.name}")  # fmt: skip
    axes.errorbar(at if fault.over_rate else at + zero, value, yerr=1.96 * std, fmt="o", ms=5, color=COLOURS[0],
                  capsize=3, elinewidth=1.4, label="measured − model, mean, 95 %")  # fmt: skip
    axes.axhline(0.0, color=GREY, lw=0.8)
    name = fault.suspect.signal.replace("_", " ")
    over = f"rate of {name}, {about.display_unit}/s" if fault.over_rate else f"{name}, {about.display_unit}"
    axes.set_xlabel(over, fontsize=9, color=INK)
    axes.set_ylabel(f"{name} reads too much, {about.display_unit}", fontsize=9, color=INK)
    _finish(figure, axes)
    return figure


def _finish(figure, axes) -> None:
    axes.grid(color="#e4e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=8)
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
    axes.axvspan(-2, 2, color=PRIOR_COLOUR, lw=0, alpha=0.5)
    axes.axvspan(-1, 1, color=PRIOR_COLOUR, lw=0)
    rows = np.arange(len(known))[::-1]
    names, most = [], 3.0
    for row, k in zip(rows, known, strict=True):
        u, x, std = final.problem.unknowns[k], final.x[k], final.std[k]
        before, spread = first[u.name]
        axes.errorbar(before, row + 0.14, xerr=1.96 * spread, fmt="o", mfc="white", ms=5, color="#9a6700", capsize=2)
        axes.errorbar(x, row - 0.14, xerr=1.96 * std, fmt="o", ms=5, color=COLOURS[1], capsize=2)
        value = format_with_error(final.values[u.name], final.standard_errors[u.name], u.unit)
        names.append(f"{u.name.replace('_', ' ')}   {value}")
        most = max(most, abs(before) + 1.96 * spread, abs(x) + 1.96 * std)
    axes.set_xlim(-1.1 * most, 1.1 * most)
    axes.set_yticks(rows, names, fontsize=9, color=INK)
    axes.set_xlabel("distance from what was believed, in its standard deviations (grey: ±1, ±2)", fontsize=9, color=INK)
    legend = "○ calibrated without the effect   ● with what was accepted   (95 %)"
    axes.set_title(legend, fontsize=9, loc="left", color=INK)
    axes.grid(True, axis="x", color="#d8dee4", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(axis="x", colors=GREY, labelsize=8)
    return figure



TITLES = {Use.FIT: "runs it was fitted to", Use.HOLDOUT: "runs that no fit has seen"}
FLOOR = 0.7  # where the bars begin
TICKS = (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
STANDS, FALLS, RISES = "#aab4be", COLOURS[2], COLOURS[1]
FORMULA = "formula alone"


def stages(diagnosis: Diagnosis) -> dict[str, dict[Use, float]]:
    """Residual over noise after each stage, by use of the runs.

    Where no effect of the library explains it, the last stage is the best formula in place of all effects.
    """
    campaign = diagnosis.campaign
    out = {
        "present model": _levels(campaign, diagnosis.before),
        "calibrated": _levels(campaign, diagnosis.calibrated.residuals),
    }
    later = [*(r.before for r in diagnosis.rounds[1:]), diagnosis.after]
    for r, after in zip(diagnosis.rounds, later, strict=True):
        if r.accepted is not None:
            out[f"+ {r.accepted.suspect.name}"] = _levels(campaign, after.residuals)
    best = diagnosis.forms[0].judged if diagnosis.verdict is Verdict.UNKNOWN_EFFECT and diagnosis.forms else None
    return out if best is None else out | {FORMULA: _levels(campaign, best.residuals)}


def _levels(campaign: Campaign, residuals) -> dict[Use, float]:
    found = {use: rms_by_signal(campaign, residuals, use) for use in Use}
    return {use: row[OVERALL] for use, row in found.items() if OVERALL in row}


def draw_waterfall(diagnosis: Diagnosis):
    """A matplotlib figure: one panel for the fitted runs, one for those held out; residual over noise, logarithmic."""
    from matplotlib.figure import Figure

    table = stages(diagnosis)
    uses = [use for use in Use if all(use in row for row in table.values())]
    figure = Figure(figsize=(6.2, 0.8 + (0.6 + 0.34 * len(table)) * len(uses)), layout="constrained")
    cells = figure.subplots(len(uses), 1, squeeze=False, sharex=True)[:, 0]
    for axes, use in zip(cells, uses, strict=True):
        draw_stages(axes, diagnosis, use)
        axes.set_title(TITLES[use], fontsize=9, loc="left", color=INK)
    cells[-1].set_xlabel("residual over noise; green: taken away; dashed: the noise", fontsize=8.5, color=INK)
    return figure


def draw_stages(axes, diagnosis: Diagnosis, use: Use) -> None:
    """The waterfall of the runs of one use, into matplotlib axes."""
    table = stages(diagnosis)
    names, values = list(table), [min(row[use], TICKS[-1]) for row in table.values()]
    most = min(max(value for row in table.values() for value in row.values()), TICKS[-1])
    for k, value in enumerate(values):
        # a formula stands in place of all effects, so its fall begins at the calibrated model
        before = value if k == 0 else values[1] if names[k] == FORMULA else values[k - 1]
        axes.barh(k, value - FLOOR, left=FLOOR, height=0.6, color=STANDS)
        colour = FALLS if before >= value else RISES
        axes.barh(k, abs(before - value), left=min(before, value), height=0.6, color=colour)
        told = f"{value:.2f}" if value < TICKS[-1] else f"{value:.0f} or more"
        axes.annotate(f" {told}", (max(before, value), k), va="center", fontsize=9, color=INK)
    axes.axvline(1.0, color=COLOURS[0], lw=1.2, ls="--")
    axes.set_xscale("log")
    axes.set_xlim(FLOOR, 1.7 * max(most, 1.5))
    axes.set_ylim(len(names) - 0.5, -0.5)
    shown = [t for t in TICKS if t <= 1.7 * most] or [1]
    axes.set_xticks(shown, [f"{t}" for t in shown], fontsize=8, color=GREY)
    axes.minorticks_off()
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names], fontsize=9, color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(length=0)
