"""The figure of the error of a faulty sensor."""

from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import from_si
from edhas_jax.diagnosis.report.sensor_fault import SensorError

Z_95 = 1.96  # standard errors on either side of a 95 % interval


def draw_sensor_fault(error: SensorError):
    """Draw the error of a sensor over its signal, or over the rate of change: measured, and by the accepted fault.

    Returns:
        A matplotlib figure.
    """
    from edhas_jax.core.figure import Figure

    about = error.about
    figure = Figure(figsize=(7.6, 4.2), layout="constrained")
    axes = figure.subplots()
    zero = from_si(0.0, about.unit, about.display_unit)
    x, measured, modelled, std = (
        from_si(v, about.unit, about.display_unit) - zero for v in (error.x, error.measured, error.modelled, error.std)
    )
    x = x if error.over_rate else x + zero
    axes.plot(x, modelled, color=COLOURS[1], lw=1.6, label=f"fault that was found: {error.candidate.name}")
    axes.errorbar(x, measured, yerr=Z_95 * std, fmt="o", ms=5, color=COLOURS[0], capsize=3, elinewidth=1.4,
                  label="measured − model, mean, 95 %")  # fmt: skip
    axes.axhline(0.0, color=GREY, lw=0.8)
    name = error.candidate.signal.replace("_", " ")
    label = f"rate of {name}, {about.display_unit}/s" if error.over_rate else f"{name}, {about.display_unit}"
    axes.set_xlabel(label, fontsize=9, color=INK)
    axes.set_ylabel(f"error of {name}, {about.display_unit}", fontsize=9, color=INK)
    _style(figure, axes)
    return figure


def _style(figure, axes) -> None:
    axes.grid(color="#e4e7eb", lw=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=8)
    figure.legend(loc="outside upper left", ncols=2, fontsize=9, frameon=False)
