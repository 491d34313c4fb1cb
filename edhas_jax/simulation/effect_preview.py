"""The signature of an effect: what a typical size of it does to the signals of a run, where it shows most."""

from typing import NamedTuple

import numpy as np

from edhas_jax.core import structs
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
# what a bench engineer would run: idle, loaded, fast, with warm oil, at the limit of the supply
BENCH_RUNS = (
    {"frequency": 10.0},
    {"frequency": 20.0, "load_orifice_area": 1e-6},
    {"frequency": 30.0},
    {"frequency": 20.0, "load_orifice_area": 1e-6, "oil_temperature": 333.15},
    {"frequency": 30.0, "supply_voltage": 15.0},
)
SYSTEM_RUNS = ({"load_force": 0.0}, {"load_force": 300.0})


class EffectPreview(NamedTuple):
    """Signals (SI) of one run without and with the effect, over `time` [s], under `conditions` (SI)."""

    effect: Effect
    machine: Rig
    conditions: dict[str, float]
    time: np.ndarray
    without: dict[str, np.ndarray]
    present: dict[str, np.ndarray]

    def strength(self) -> float:
        """The largest rms change of a signal as a share of its range."""
        changes = {n: self.present[n] - values for n, values in self.without.items()}
        return max(float(np.sqrt(np.mean(changes[n] ** 2)) / (np.ptp(v) + 1e-30)) for n, v in self.without.items())


def preview_effect(effect: Effect) -> EffectPreview:
    """The signature of an effect on the nominal machine it acts on, in that of some usual runs which shows it best.

    Raises:
        EffectError: it acts on no rig with a pump.
        SimulationError: with it the run leaves the physical range.
    """
    machine = _machine_for(effect)
    mounted = structs.replace(machine, effects=(*(e for e in machine.effects if e.id != effect.id), effect))
    machine = structs.replace(machine, effects=tuple(e for e in machine.effects if e.id != effect.id))
    is_bench, found = isinstance(machine, PumpBench), []
    how = Simulation(duration=0.3 if is_bench else 0.6)
    for conditions in BENCH_RUNS if is_bench else SYSTEM_RUNS:
        runs = [simulate(change(m, **conditions), how).signals for m in (machine, mounted)]
        first = how.duration - 1.0 / conditions["frequency"] if is_bench else 0.0  # the last cycle, or all of a step
        inside = runs[0]["time"] >= first - 1e-9
        cut = [{n: run[n][inside] for n in PREVIEW_SIGNALS if n in run} for run in runs]
        found.append(EffectPreview(effect, machine, conditions, runs[0]["time"][inside], *cut))
    return max(found, key=EffectPreview.strength)


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


def plot_preview(shown: EffectPreview):
    """A matplotlib figure: each signal without and with the effect, and beside it the difference."""
    from matplotlib.figure import Figure  # slow to import

    names = list(shown.without)
    figure = Figure(figsize=(11.0, 1.3 + 1.35 * len(names)), layout="constrained")
    grid = figure.subplots(len(names), 2, sharex=True, squeeze=False, width_ratios=(1.5, 1.0))
    t = (shown.time - shown.time[0]) * 1e3
    for (left, right), name in zip(grid, names, strict=True):
        unit, shown_in = SIGNALS[name].unit, SIGNALS[name].display_unit
        without, present = (from_si(v[name], unit, shown_in) for v in (shown.without, shown.present))
        left.plot(t, without, color=GREY, lw=2.4, label="without")
        left.plot(t, present, color=COLOURS[1], lw=1.2, label="with")
        right.plot(t, present - without, color=COLOURS[1], lw=1.2)
        right.axhline(0.0, color=GREY, lw=0.6)
        left.set_ylabel("\n".join((*name.split("_", 1), shown_in)).replace("_", " "), fontsize=8.5)
        right.set_ylabel(shown_in, fontsize=8.5)
        for axes in (left, right):
            axes.grid(color="#e4e7eb", lw=0.6)
            axes.tick_params(labelsize=8, colors=INK)
            axes.margins(x=0.0)
            axes.spines[["top", "right"]].set_visible(False)
    grid[0, 0].legend(frameon=False, fontsize=8.5, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.98))
    grid[0, 0].set_title("the signal", fontsize=9.5, loc="left")
    grid[0, 1].set_title("what the effect changes", fontsize=9.5, loc="left")
    for axes in grid[-1]:
        axes.set_xlabel("time, ms", fontsize=8.5)
    cls = type(shown.effect)
    sizes = (f"{p.name} {format_quantity(getattr(shown.effect, p.name), p.unit)}" for p in structs.parameters(cls))
    size = ", ".join(sizes)
    figure.suptitle(f"{cls.id} ({size})\n{shown.machine.name}, {_conditions(shown)}", fontsize=10.5, color=INK)
    return figure


def _conditions(shown: EffectPreview) -> str:
    known = {n: find_parameter(shown.machine, n)[0] for n in shown.conditions}
    return ", ".join(f"{n.replace('_', ' ')} {format_quantity(v, known[n].unit)}" for n, v in shown.conditions.items())
