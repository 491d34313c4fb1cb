"""The paper's six figures redrawn from our machine, with the values that the paper states marked on them."""

import dataclasses
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.machine.effects import SuctionLineResistance
from edhas_jax.machine.rigs import ActuatorSystem, PumpBench
from studies.paper.published_numbers import FIGURES
from studies.paper.readings import LPM, SAMPLES, mean_flows, peak, settled_cycle, swept_volume

DPI = 110
AT_REST = (
    ("0.5 % air, at rest 0.2 MPa", {}, COLOURS[0]),
    ("0.5 % air, at rest 0.1 MPa", {"accumulator_pressure": 0.1e6}, COLOURS[2]),
    ("5 % air, at rest 0.1 MPa", {"accumulator_pressure": 0.1e6, "air_fraction": 0.05}, COLOURS[3]),
)
# a rival for the fall of flow: light balls, and oil that has to be sucked through a long thin line from a tank
STARVED = {
    "accumulator_pressure": 0.1e6, "line_resistance": 1.2e9, "valve_mass": 1e-3, "valve_seat_diameter": 5e-3,
    "valve_spring_rate": 500.0, "valve_preload": 0.2,
}  # fmt: skip
NOMINAL, CALIBRATED, PAPER = GREY, COLOURS[0], COLOURS[1]
ANGLE = 360.0 * np.arange(SAMPLES) / SAMPLES


@dataclasses.dataclass(frozen=True)
class Machines:
    """Bench and system of one set of parameters, the name and colour they are drawn in."""

    bench: PumpBench
    system: ActuatorSystem
    label: str
    colour: str

    def cycle(self) -> dict[str, np.ndarray]:
        """A settled cycle at 10 Hz, by signal (SAMPLES,)."""
        return {n: v[:, 0] for n, v in settled_cycle(self.bench, self.alone(), 10.0)[0].items()}

    def alone(self) -> dict[str, np.ndarray]:
        """A table whose only row is this bench."""
        return {"position_gain": np.array([float(edhas.get(self.bench, "position_gain"))])}


def save_pictures(nominal: Machines, calibrated: Machines, frequencies, folder: Path) -> list[Path]:
    """Draw and save the six figures; their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    both = nominal, calibrated
    drawn = {
        "tracking": draw_tracking(both), "pressure": draw_pressure(both), "flow": draw_flow(both, frequencies),
        "instantaneous": draw_instantaneous(calibrated), "leakage": draw_leakage(both), "step": draw_step(both),
    }  # fmt: skip
    paths = []
    for name, figure in drawn.items():
        paths.append(folder / f"paper_{name}.png")
        figure.savefig(paths[-1], dpi=DPI)
    return paths


def draw_tracking(both: tuple[Machines, ...]) -> Figure:
    """Piston and set point over a cycle at 10 Hz, and the top of the stroke enlarged with the paper's two readings."""
    figure, (whole, top) = _figure("Piston tracking of a 10 Hz sine, amplitude 3.5 mm", 2)
    wanted = 3.5 * np.sin(np.radians(ANGLE))
    for axes in (whole, top):
        axes.plot(ANGLE, wanted, color=INK, lw=1.2, ls="--", label="set point")
    for m in both:
        position = 1e3 * m.cycle()["piston_position"]
        whole.plot(ANGLE, position, color=m.colour, lw=1.6, label=f"piston, {m.label}")
        top.plot(ANGLE, position, color=m.colour, lw=1.6)
        place, height = (float(v) for v in peak(position))
        top.plot(ANGLE[1] * place, height, "o", color=m.colour, ms=6)
    for name, marker, value in (("simulated", "D", "simulated"), ("measured", "s", "measured")):
        lag, loss = (getattr(FIGURES[k], value) for k in ("lag", "loss"))
        filled = "white" if marker == "s" else PAPER
        top.plot(90.0 + lag, 3.5 * (1.0 - loss / 100.0), marker, color=PAPER, ms=8, mfc=filled, ls="",
                 label=f"paper, {name}: {lag:.2f}°, {loss:.2f} %")  # fmt: skip
    top.axvline(90.0, color=GREY, lw=0.7, ls=":")
    _format_axes(whole, "phase of the set point, °", "position from mid-stroke, mm", xlim=(0, 360), ylim=(-4.4, 5.4))
    whole.set_xticks(range(0, 361, 90))
    _format_axes(top, "phase of the set point, °", "", xlim=(81, 101), ylim=(3.440, 3.513))
    top.set_title("the peak, enlarged; dots: our maxima", fontsize=9, loc="left", color=INK)
    whole.legend(frameon=False, fontsize=8.5, loc="upper right")
    top.legend(frameon=False, fontsize=8.5, loc="lower center")
    return figure


def draw_pressure(both: tuple[Machines, ...]) -> Figure:
    """Outlet pressure above rest, brought in softly; and the first milliseconds of a start at full amplitude."""
    figure, (whole, begin) = _figure("Outlet pressure above its value at rest, 10 Hz", 2)
    for m in both:
        whole.plot(*_rise(m.bench, 0.35), color=m.colour, lw=1.5, label=f"ours, {m.label}")
    for name, changes, colour in AT_REST:
        machine = edhas.change(both[-1].bench, ramp_time=0.0, **changes)
        begin.plot(*_rise(machine, 0.006), color=colour, lw=1.5, label=name)
    for value, name, ls in ((38.0, "simulated", "-"), (37.0, "measured", "--")):
        whole.axhline(value, color=PAPER, lw=1.1, ls=ls, label=f"paper, peak, {name}: {value:.0f} kPa")
    _format_axes(whole, "time, ms", "pressure above rest, kPa", xlim=(0, 350), ylim=(-3, 52))
    _format_axes(begin, "time, ms", "", xlim=(0, 6), ylim=(-3, 78))
    begin.set_title("start at full amplitude, calibrated machine: flat at first", fontsize=9, loc="left", color=INK)
    whole.legend(frameon=False, fontsize=8.5, loc="upper left", ncols=2)
    begin.legend(frameon=False, fontsize=8.5, loc="upper right")
    return figure


def _rise(machine: PumpBench, duration: float) -> tuple[np.ndarray, np.ndarray]:
    run = edhas.simulate(machine, edhas.Simulation(duration=duration, sample_rate=20e3)).signals
    return 1e3 * run["time"], 1e-3 * (run["outlet_pressure"] - run["outlet_pressure"][0])


def starved_bench(bench: PumpBench) -> PumpBench:
    """A bench with light balls and a long thin suction line."""
    with_line = structs.replace(bench, effects=(*bench.effects, SuctionLineResistance()))
    return edhas.change(with_line, **STARVED)


def draw_flow(both: tuple[Machines, ...], frequencies) -> Figure:
    """Mean flow over frequency."""
    figure, (axes,) = _figure("Mean flow over frequency", 1)
    ideal = np.array(frequencies) * swept_volume(both[0].bench)
    axes.plot(frequencies, ideal, color=INK, lw=1.0, ls=":", label="swept volume")
    for m in both:
        axes.plot(frequencies, mean_flows(m.bench, m.alone(), frequencies)[:, 0], color=m.colour, lw=2.0,
                  label=f"ours, {m.label}")  # fmt: skip
    starved = mean_flows(starved_bench(both[0].bench), both[0].alone(), frequencies)[:, 0]
    axes.plot(frequencies, starved, color=COLOURS[3], lw=1.4, ls="--",
              label="ours, suction starved instead of valves late")  # fmt: skip
    axes.axvline(30.0, color=PAPER, lw=1.1)
    axes.annotate("paper: proportional to\nabout here, then falling", (30.0, 0.25), (6, 0), textcoords="offset points",
                  color=PAPER, fontsize=9)  # fmt: skip
    at_30 = 30.0 * swept_volume(both[0].bench)
    filling = FIGURES["filling"]
    for share, marker, name in ((filling.simulated, "D", "simulated"), (filling.measured, "s", "measured")):
        axes.plot(30.0, share * at_30, marker, color=PAPER, ms=7, mfc="white" if marker == "s" else PAPER, ls="",
                  label=f"paper, {name}, if its earlier model\ndelivers the swept volume")  # fmt: skip
    _format_axes(axes, "frequency, Hz", "mean flow, L/min", xlim=(0, 60), ylim=(0, 4.9))
    axes.legend(frameon=False, fontsize=8.5, loc="upper left")
    return figure


def draw_instantaneous(machines: Machines) -> Figure:
    """Flow to the load and through the delivery valves over a cycle, and the backflow enlarged."""
    figure, (whole, small) = _figure(f"Instantaneous flow at 10 Hz, {machines.label} machine", 2)
    cycle = machines.cycle()
    half = SAMPLES // 2  # chamber B does half a cycle later what chamber A does
    rows = (
        ("to the load", cycle["outlet_flow"], "#c3cad1", 4.5, "-"),
        ("delivery valve A", cycle["delivery_flow_a"], COLOURS[0], 1.4, "-"),
        ("delivery valve B", np.roll(cycle["delivery_flow_a"], half), COLOURS[2], 1.4, "-"),
        ("suction valve A", cycle["suction_flow_a"], COLOURS[1], 1.4, "--"),
        ("suction valve B", np.roll(cycle["suction_flow_a"], half), COLOURS[4], 1.4, "--"),
        ("past plunger A", cycle["leakage_a"], COLOURS[3], 1.4, "-"),
    )
    for name, values, colour, width, style in rows:
        whole.plot(ANGLE, LPM * values, color=colour, lw=width, ls=style, label=name)
        small.plot(ANGLE, LPM * values, color=colour, lw=width, ls=style)
    _format_axes(whole, "phase of the set point, °", "flow, L/min", xlim=(0, 360), ylim=(-0.1, 2.35))
    _format_axes(small, "phase of the set point, °", "flow, L/min", xlim=(86, 102), ylim=(-0.02, 0.08))
    whole.set_xticks(range(0, 361, 90))
    small.axhline(0.0, color=GREY, lw=0.7)
    small.set_title("the reversal, enlarged: a valve that closes late lets oil back", fontsize=9, loc="left", color=INK)
    whole.legend(frameon=False, fontsize=8.5, loc="upper center", ncols=2)
    return figure


def draw_leakage(both: tuple[Machines, ...]) -> Figure:
    """What leaves chamber A by the gap and backwards through its valves over a cycle."""
    figure, (axes,) = _figure("Internal leakage of chamber A at 10 Hz", 1)
    for m in both:
        cycle = m.cycle()
        back = -1e3 * LPM * (np.minimum(cycle["delivery_flow_a"], 0.0) + np.minimum(cycle["suction_flow_a"], 0.0))
        axes.plot(ANGLE, back, color=m.colour, lw=1.4, label=f"back through the valves of chamber A, {m.label}")
    axes.plot(ANGLE, 1e3 * LPM * cycle["leakage_a"], color=COLOURS[3], lw=1.6,
              label="past the plunger, which drags oil along (both)")  # fmt: skip
    stroke, spike = (1e3 * FIGURES[k].simulated for k in ("leak_stroke", "leak_spike"))
    for value, name, ls in ((stroke, "below, in the stroke", "--"), (spike, "spike at the end of the stroke", "-")):
        axes.axhline(value, color=PAPER, lw=1.1, ls=ls, label=f"paper, simulated: {name}, {value:.0f} mL/min")
    axes.axhline(-stroke, color=PAPER, lw=1.1, ls="--")
    for x, text in ((0, "delivery"), (180, "suction"), (315, "delivery")):
        axes.annotate(text, (x + 45 if x == 0 else x if x == 180 else x, -9.0), color=GREY, fontsize=9, ha="center")
    for x in (90, 270):
        axes.axvline(x, color=GREY, lw=0.7, ls=":")
    _format_axes(axes, "phase of the set point, ° (the piston is at its ends at 90° and 270°)", "leakage, mL/min",
           xlim=(0, 360), ylim=(-10, 32))  # fmt: skip
    axes.set_xticks(range(0, 361, 45))
    axes.legend(frameon=False, fontsize=8.5, loc="upper left", ncols=1)
    return figure


def draw_step(both: tuple[Machines, ...]) -> Figure:
    """Cylinder over time for a step of 15 mm, and its arrival enlarged."""
    figure, (whole, end) = _figure("Cylinder, step of 15 mm", 2)
    for axes in (whole, end):
        axes.axhline(15.0, color=INK, lw=1.0, ls="--", label="target")
        axes.axhspan(14.7, 15.3, color="#eaeef2", zorder=0, label="within 2 %")
    for m in both:
        run = edhas.simulate(m.system, edhas.Simulation(duration=0.6, sample_rate=2e3)).signals
        time, position = 1e3 * run["time"], 1e3 * run["cylinder_position"]
        for axes in (whole, end):
            axes.plot(time, position, color=m.colour, lw=1.8, label=f"ours, {m.label}")
    response = FIGURES["response"]
    for value, ls, name in ((response.simulated, "-", "simulated"), (response.measured, "--", "measured")):
        for axes in (whole, end):
            axes.axvline(1e3 * value, color=PAPER, lw=1.2, ls=ls, label=f"paper, {name}: {1e3 * value:.1f} ms")
    _format_axes(whole, "time, ms", "position, mm", xlim=(0, 600), ylim=(0, 16.5))
    _format_axes(end, "time, ms", "", xlim=(330, 470), ylim=(13.0, 15.4))
    end.set_title("arrival, enlarged", fontsize=9, loc="left", color=INK)
    end.legend(frameon=False, fontsize=8.5, loc="lower right")
    return figure


def _figure(title: str, count: int) -> tuple[Figure, tuple]:
    figure = Figure(figsize=(9.6, 4.2) if count == 2 else (7.4, 4.4), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11, color=INK)
    return figure, tuple(figure.subplots(1, count, squeeze=False)[0])


def _format_axes(axes, x: str, y: str, **limits) -> None:
    axes.set(xlabel=x, ylabel=y, **limits)
    axes.grid(True, color="#d8dee4", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(colors=GREY, labelsize=8.5)
