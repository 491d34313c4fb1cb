"""The picture of `studies.controllers.comparison`: every comparison in one figure."""

import numpy as np

NAMES = {"pid": "PID", "cascade": "cascade", "antsmc": "ANTSMC"}
COLOURS = {"pid": "#0969da", "cascade": "#9a6700", "antsmc": "#d1490c"}
LINES = {"continuous": {"ls": (0, (4, 2)), "lw": 1.1, "alpha": 0.75}, "5khz": {"ls": "-", "lw": 1.8}}
FACES = {"continuous": "white", "5khz": None}  # of the dots; None: filled
HOW = {"continuous": "continuous", "5khz": "5 kHz, one sample late"}
GREY = "#6e7781"


def picture(found, conditions, load_time):
    """Tracking over frequency, disturbances at both frequencies, both steps, and what sampling costs."""
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(14.5, 8.2), layout="constrained")
    axes = figure.subplots(2, 3)
    _tracking(axes[0, 0], found)
    _disturbed(axes[0, 1], found, list(conditions), 0)
    _disturbed(axes[0, 2], found, list(conditions), 1)
    _step(axes[1, 0], found)
    _load_step(axes[1, 1], found, load_time)
    _sampling(axes[1, 2], found)
    for one in axes.flat:
        one.spines[["top", "right"]].set_visible(False)
    names = dict.fromkeys(name for name, _ in found.errors)
    handles = [Line2D([], [], color=COLOURS[n], lw=2.2, label=NAMES[n]) for n in names]
    handles += [
        Line2D([], [], color=GREY, label=HOW[how], marker="o", markerfacecolor=FACES[how] or GREY, **LINES[how])
        for how in LINES
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False, fontsize=10)
    figure.suptitle("The piston's controllers, tuned by gradient at 10 and 30 Hz under load and with steps", x=0.01,
                    ha="left", fontsize=13)  # fmt: skip
    return figure


def _tracking(axes, found) -> None:
    for (name, how), errors in found.tracking.items():
        axes.loglog(found.frequencies, 1e6 * errors, color=COLOURS[name], **LINES[how])
    axes.set_xlim(found.frequencies[0], found.frequencies[-1])
    ticks = [1, 2, 5, 10, 20, 30, 60]
    axes.set_xticks(ticks, [str(t) for t in ticks])
    axes.minorticks_off()
    axes.set(title="Tracking a sine of 3.5 mm", xlabel="frequency, Hz", ylabel="rms error, µm")
    axes.grid(axis="y", color="#d8dee4", lw=0.6)


def _disturbed(axes, found, conditions, column) -> None:
    rows = np.arange(len(conditions))[::-1]
    keys = list(found.errors)
    for k, (name, how) in enumerate(keys):
        at = rows + 0.55 * (0.5 - (k + 0.5) / len(keys))
        face = FACES[how] or COLOURS[name]
        values = 1e6 * found.errors[name, how][:, column]
        axes.hlines(at, 1e-2, values, color=COLOURS[name], lw=0.8, alpha=0.35)
        axes.semilogx(values, at, "o", color=COLOURS[name], markerfacecolor=face, ms=6)
    values = 1e6 * np.stack([e[:, column] for e in found.errors.values()])
    axes.set_xlim(0.5 * values.min(), 2.0 * values.max())
    axes.set_yticks(rows, conditions)
    axes.set_ylim(-0.6, len(conditions) - 0.4)
    axes.grid(axis="x", color="#d8dee4", lw=0.6)
    axes.set(title=f"Disturbed, {(10, 30)[column]} Hz", xlabel="rms error, µm")


def _step(axes, found) -> None:
    time, reference, _ = next(iter(found.traces.values()))
    for (name, how), (_, _, position) in found.traces.items():
        axes.plot(1e3 * time, 1e3 * position, color=COLOURS[name], **LINES[how])
    axes.plot(1e3 * time, 1e3 * reference, color=GREY, lw=1.0, ls=":")
    axes.set(title="A step of the set point", xlabel="time, ms", ylabel="piston position, mm", xlim=(3, 25))
    axes.set_ylim(-0.1, max(1.6, min(2.6, 1.05e3 * max(p.max() for _, _, p in found.traces.values()))))


def _load_step(axes, found, load_time) -> None:
    lowest, highest = -1.0, 1.0
    for (name, how), (time, _, position) in found.traces.items():
        begin = np.searchsorted(time, load_time)
        deviation = 1e6 * (position - position[begin - 1])
        lowest, highest = min(lowest, deviation[begin:].min()), max(highest, deviation[begin:].max())
        axes.plot(1e3 * (time - load_time), deviation, color=COLOURS[name], **LINES[how])
    axes.set(title="A force of 50 N at rest", xlabel="time after the force, ms", ylabel="deviation, µm", xlim=(-2, 30))
    axes.set_ylim(1.15 * max(lowest, -400.0), 20.0 + 1.15 * min(highest, 200.0))
    axes.grid(axis="y", color="#d8dee4", lw=0.6)


def _sampling(axes, found) -> None:
    for name, errors in found.sampled.items():
        axes.loglog(1e3 * found.sample_times, 1e6 * errors, color=COLOURS[name], **LINES["5khz"])
        if (name, "continuous") in found.errors:
            axes.axhline(1e6 * found.errors[name, "continuous"][0, 1], color=COLOURS[name], **LINES["continuous"])
    axes.axvline(0.2, color=GREY, lw=0.8, ls=":")
    axes.annotate("tuned here", (0.2, 0.97), (4, 0), xycoords=("data", "axes fraction"), textcoords="offset points",
                  fontsize=8, va="top", color=GREY)  # fmt: skip
    ticks = [0.05, 0.1, 0.2, 0.5]
    axes.set_xticks(ticks, [f"{t:g}" for t in ticks])
    axes.minorticks_off()
    axes.set(title="Other sample times, same gains, 30 Hz", xlabel="sample time = delay, ms", ylabel="rms error, µm")
    axes.grid(axis="y", color="#d8dee4", lw=0.6)
