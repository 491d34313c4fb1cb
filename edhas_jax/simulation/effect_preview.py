"""Preview of an effect: how it changes the signals of that standard run in which its influence is largest."""

from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.chart import style_axes
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.units import format_quantity, from_si
from edhas_jax.machine.effects import Effect, EffectError, EntrainedAir, KarnoppFriction, LugreFriction, PistonLeakage
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.signals import SIGNALS
from edhas_jax.machine.parameters import change, find_parameter
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench, Rig
from edhas_jax.simulation.run import Simulation, simulate

PREVIEW_SIGNALS = (
    "voltage", "current", "piston_position", "chamber_pressure_a", "outlet_pressure", "outlet_flow", "head_pressure",
    "cylinder_position",
)  # fmt: skip
# standard runs: low load, loaded, fast, with warm oil, at the limit of the supply
BENCH_RUNS = (
    {"frequency": 10.0},
    {"frequency": 20.0, "load_orifice_area": 1e-6},
    {"frequency": 30.0},
    {"frequency": 20.0, "load_orifice_area": 1e-6, "oil_temperature": 333.15},
    {"frequency": 30.0, "supply_voltage": 15.0},
)
SYSTEM_RUNS = ({"load_force": 0.0}, {"load_force": 300.0})


class EffectPreview(NamedTuple):
    """One run without and with an effect.

    Attributes:
        effect: the effect.
        machine: the machine without it.
        conditions: parameters of the run, SI.
        time: times of the samples [s], (samples,).
        without_effect: signals in SI by name, each (samples,).
        with_effect: the same signals with the effect.
    """

    effect: Effect
    machine: Rig
    conditions: dict[str, float]
    time: np.ndarray
    without_effect: dict[str, np.ndarray]
    with_effect: dict[str, np.ndarray]

    def largest_change(self) -> float:
        """The largest rms change of a signal, as a share of its range."""
        changes = {n: self.with_effect[n] - values for n, values in self.without_effect.items()}
        ranges = {n: np.ptp(values) + 1e-30 for n, values in self.without_effect.items()}
        return max(float(np.sqrt(np.mean(changes[n] ** 2)) / ranges[n]) for n in changes)


def preview_effect(effect: Effect) -> EffectPreview:
    """Preview an effect on the nominal machine it acts on, in that standard run in which it changes signals most.

    Raises:
        EffectError: the effect acts on no rig with a pump.
        SimulationError: a run with the effect leaves the physical range.
    """
    machine = _machine_for(effect)
    mounted = structs.replace(machine, effects=(*(e for e in machine.effects if e.id != effect.id), effect))
    machine = structs.replace(machine, effects=tuple(e for e in machine.effects if e.id != effect.id))
    is_bench, previews = isinstance(machine, PumpBench), []
    settings = Simulation(duration=0.3 if is_bench else 0.6)
    for conditions in BENCH_RUNS if is_bench else SYSTEM_RUNS:
        runs = [simulate(change(m, **conditions), settings).signals for m in (machine, mounted)]
        first = settings.duration - 1.0 / conditions["frequency"] if is_bench else 0.0  # last cycle, or whole step
        inside = runs[0]["time"] >= first - 1e-9
        signals = [{n: run[n][inside] for n in PREVIEW_SIGNALS if n in run} for run in runs]
        previews.append(EffectPreview(effect, machine, conditions, runs[0]["time"][inside], *signals))
    return max(previews, key=EffectPreview.largest_change)


def _machine_for(effect: Effect) -> Rig:
    """The nominal refined machine of the first rig that the effect can act on."""
    pump = LugreFriction(), PistonLeakage(), EntrainedAir()
    for machine in (PumpBench(effects=pump), ActuatorSystem(effects=(*pump, KarnoppFriction()))):
        bare = structs.replace(machine, effects=tuple(e for e in machine.effects if e.id != effect.id))
        try:
            check_effect(effect, bare)
        except EffectError as error:
            reason = error
        else:
            return machine
    raise reason


def plot_preview(preview: EffectPreview):
    """A matplotlib figure: each signal without and with the effect, and the difference beside it."""
    from edhas_jax.core.figure import Figure  # slow to import

    names = list(preview.without_effect)
    figure = Figure(figsize=(11.0, 1.3 + 1.35 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), 2, sharex=True, squeeze=False, width_ratios=(1.5, 1.0))
    t = (preview.time - preview.time[0]) * 1e3
    for (left, right), name in zip(grid, names, strict=True):
        unit, display_unit = SIGNALS[name].unit, SIGNALS[name].display_unit
        both = preview.without_effect, preview.with_effect
        without_effect, with_effect = (from_si(values[name], unit, display_unit) for values in both)
        left.plot(t, without_effect, color=GREY, lw=2.4, label="without")
        left.plot(t, with_effect, color=COLOURS[1], lw=1.2, label="with")
        right.plot(t, with_effect - without_effect, color=COLOURS[1], lw=1.2)
        right.axhline(0.0, color=GREY, lw=0.6)
        title = "\n".join((*name.split("_", 1), display_unit)).replace("_", " ")
        for axes, y_title in ((left, title), (right, display_unit)):
            style_axes(axes, "time, ms" if axes in grid[-1] else "", y_title)
            axes.margins(x=0.0)
    grid[0, 0].legend(frameon=False, fontsize=8.5, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    grid[0, 0].set_title("the signal", fontsize=9.5, loc="left")
    grid[0, 1].set_title("change by the effect", fontsize=9.5, loc="left")
    cls = type(preview.effect)
    sizes = (f"{p.name} {format_quantity(getattr(preview.effect, p.name), p.unit)}" for p in structs.parameters(cls))
    size = ", ".join(sizes)
    figure.suptitle(f"{cls.id} ({size})\n{preview.machine.name}, {_conditions_text(preview)}", fontsize=10.5, color=INK)
    return figure


def _conditions_text(preview: EffectPreview) -> str:
    """The parameters of the run as text."""
    units = {n: find_parameter(preview.machine, n)[0].unit for n in preview.conditions}
    return ", ".join(f"{n.replace('_', ' ')} {format_quantity(v, units[n])}" for n, v in preview.conditions.items())
