"""The waterfall: how the error falls from the present model over calibration and each effect down to the noise."""

from edhas_jax.campaign import Campaign, Use
from edhas_jax.diagnosis import Diagnosis, Verdict
from edhas_jax.figures import COLOURS, INK, QUIET
from edhas_jax.misfit import OVERALL, levels

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
    found = {use: levels(campaign, residuals, use) for use in Use}
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
    axes.set_xticks(shown, [f"{t}" for t in shown], fontsize=8, color=QUIET)
    axes.minorticks_off()
    axes.set_yticks(range(len(names)), [name.replace("_", " ") for name in names], fontsize=9, color=INK)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(length=0)
