"""The figures in the answers to an engineer's questions about the paper's six figures (docs/paper.md).

    python -m studies.paper.questions

Each line states a quantity for the nominal and for the calibrated machine, or for the calibrated one with one change.
The last line: `lag_deg=… frictionless_loss=… peak_mpa=… starved_filling=… backflow_30_hz=… breakaway_mm=…`
"""

import argparse
import math

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.machine.rigs import PumpBench
from studies.paper.configs import NAMES, machines
from studies.paper.figures import starved_bench
from studies.paper.readings import (
    LPM,
    RUN_IN,
    SAMPLES,
    figures_at_10_hz,
    mean_flows,
    settled_cycle,
    step_figures,
    swept_volume,
)

NOMINAL = ("paper", "paper_step")
FRICTIONLESS = {"coulomb_friction": 1e-6, "static_friction": 1e-6, "bristle_damping": 0.0, "viscous_friction": 0.0}
FRICTIONS = (
    ("without friction of the mover", FRICTIONLESS),
    ("with it", {}),
    ("with 8 N instead of 4 N", {"coulomb_friction": 8.0, "static_friction": 12.0}),
)
RESTS = (0.1e6, 0.2e6, 0.3e6, 0.4e6)  # Pa, pressures at rest
STARTS = ((0.005, 0.2e6), (0.05, 0.1e6), (0.1, 0.1e6))  # air fraction, pressure at rest [Pa]
START_LIMITS = (1e3, 1e4)  # Pa above rest, whose time after an abrupt start is read
BREAKAWAYS = (100.0, 300.0, 1000.0)  # N, of the cylinder
SPIKE = 0.015  # L/min, leakage at the end of the stroke in the paper's figure


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Print the quantities; the headline figures."""
    argparse.ArgumentParser(description=__doc__.splitlines()[0]).parse_args(arguments)
    (nominal, _), (calibrated, system) = machines(NOMINAL), machines(NAMES)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in ("quantity", "nominal", "calibrated"):
        table.add_column(name, justify="left" if name == "quantity" else "right", no_wrap=True)
    found = tracking_answers(table, nominal, calibrated) | pressure_answers(table, nominal, calibrated)
    found |= flow_answers(table, nominal, calibrated) | valve_answers(table, nominal, calibrated)
    leakage_answers(table, calibrated)
    found |= step_answers(table, system)
    Console(highlight=False, width=120).print(table)
    print(" ".join(f"{key}={value:.4g}" for key, value in found.items()))
    return found


def tracking_answers(table: Table, *pair: PumpBench) -> dict[str, float]:
    """Lag and loss of the first harmonic, and what friction changes at the peak."""
    lags, losses = zip(*(first_harmonic(bench) for bench in pair), strict=True)
    table.add_row("lag of the first harmonic, 10 Hz", *(f"{v:.2f}°" for v in lags))
    table.add_row("amplitude loss of the first harmonic", *(f"{v:.2f} %" for v in losses))
    rows = [figures_at_10_hz(edhas.change(pair[1], **change), row(pair[1])) for _, change in FRICTIONS]
    for (title, _), figures in zip(FRICTIONS, rows, strict=True):
        table.add_row(f"loss at the peak, {title}", "", f"{figures['loss'][0]:.2f} %")
        table.add_row(f"lag at the peak, {title}", "", f"{figures['lag'][0]:.2f}°")
    return {"lag_deg": lags[1], "frictionless_loss": float(rows[0]["loss"][0])}


def pressure_answers(table: Table, *pair: PumpBench) -> dict[str, float]:
    """Peaks of outlet pressure, its sensitivity to the load, and its first milliseconds."""
    cycles = [signals(bench, 10.0) for bench in pair]
    peaks = [1e-6 * c["outlet_pressure"].max() for c in cycles]
    table.add_row("peak of the outlet pressure, absolute", *(f"{p:.3f} MPa" for p in peaks))
    table.add_row("flow to the load, peak", *(f"{LPM * c['outlet_flow'].max():.2f} L/min" for c in cycles))
    rows = figures_at_10_hz(pair[1], {"accumulator_pressure": np.array(RESTS)})["pressure"]
    for rest, peak in zip(RESTS, rows, strict=True):
        table.add_row(f"peak above {1e-6 * rest:.1f} MPa at rest", "", f"{peak:.4f} MPa")
    area = float(edhas.get(pair[1], "load_orifice_area"))
    at_areas = figures_at_10_hz(pair[1], {"load_orifice_area": area * np.array([0.99, 1.01])})["pressure"]
    slope = 100.0 * math.log(at_areas[1] / at_areas[0]) / math.log(1.01 / 0.99) / 100.0
    table.add_row("relative change of the peak per relative change of the load orifice", "", f"{slope:.2f}")
    for air, rest in STARTS:
        machine = edhas.change(pair[1], ramp_time=0.0, air_fraction=air, accumulator_pressure=rest)
        run = edhas.simulate(machine, edhas.Simulation(duration=0.03, sample_rate=20e3)).signals
        rise = run["outlet_pressure"] - run["outlet_pressure"][0]
        times = (1e3 * run["time"][int(np.argmax(rise > limit))] for limit in START_LIMITS)
        title = f"abrupt start, {100 * air:g} % air at {1e-6 * rest:.1f} MPa: 1 kPa and 10 kPa reached after"
        table.add_row(title, "", ", ".join(f"{t:.1f} ms" for t in times))
    return {"peak_mpa": peaks[1]}


def flow_answers(table: Table, *pair: PumpBench) -> dict[str, float]:
    """Flow over frequency with starved suction; voltage and amplitude at 30 Hz."""
    benches = ("", *pair), ("starved suction: ", None, starved_bench(pair[0]))
    for prefix, *machines_of in benches:
        flows = [None if m is None else mean_flows(m, row(m), (10.0, 20.0, 30.0, 40.0))[:, 0] for m in machines_of]
        swept = [0.0 if m is None else swept_volume(m) for m in machines_of]
        texts = [
            ("mean flow at 20 Hz over twice that at 10 Hz", lambda q, s: f"{q[1] / (2.0 * q[0]):.3f}"),
            ("mean flow at 30 Hz over swept volume", lambda q, s: f"{q[2] / (30.0 * s):.3f}"),
            ("mean flow at 40 Hz over that at 30 Hz", lambda q, s: f"{q[3] / q[2]:.3f}"),
        ]
        for title, text in texts:
            values = ("" if q is None else text(q, s) for q, s in zip(flows, swept, strict=True))
            table.add_row(prefix + title, *values)
    filling = flows[1][2] / (30.0 * swept[1])
    metrics = [edhas.simulate(edhas.change(m, frequency=30.0), edhas.Simulation(duration=0.5)).metrics for m in pair]
    table.add_row("largest voltage at 30 Hz", *(f"{m['peak_voltage'].value:.0f} V" for m in metrics))
    table.add_row("amplitude at 30 Hz over set point", *(f"{m['amplitude_ratio'].value:.3f}" for m in metrics))
    return {"starved_filling": float(filling)}


def valve_answers(table: Table, *pair: PumpBench) -> dict[str, float]:
    """Backflow through the valves, mean flow, and the pause between the strokes."""
    backflow = {}
    for frequency in (10.0, 30.0):
        cycles = [signals(m, frequency) for m in pair]
        for valve in ("delivery", "suction"):
            shares = [backflow_share(c[f"{valve}_flow_a"]) for c in cycles]
            texts = (f"{s:.3f} %" if s < 0.1 else f"{s:.1f} %" for s in shares)
            table.add_row(f"backflow through a {valve} valve at {frequency:.0f} Hz, of its flow", *texts)
            backflow[valve, frequency] = shares[1]
        if frequency == 10.0:
            table.add_row("mean flow", *(f"{LPM * c['outlet_flow'].mean():.3f} L/min" for c in cycles))
            table.add_row(
                "smallest flow to the load", *(f"{1e3 * LPM * c['outlet_flow'].min():.1f} mL/min" for c in cycles)
            )
            closed = [np.mean((c["delivery_lift_a"] <= 0.0) & (c["delivery_lift_b"] <= 0.0)) for c in cycles]
            table.add_row("pause in which no delivery valve is open, per stroke", *(f"{180 * v:.1f}°" for v in closed))
    return {"backflow_30_hz": backflow["delivery", 30.0]}


def leakage_answers(table: Table, bench: PumpBench) -> None:
    """What drives the leakage past a plunger: pressure, and the moving wall."""
    get = lambda name: float(edhas.get(bench, name))  # noqa: E731
    gap, diameter = get("piston_clearance"), get("piston_diameter")
    conductance = math.pi * diameter * gap**3 / (12.0 * get("oil_viscosity") * get("piston_fit_length"))
    speed = 2.0 * math.pi * 10.0 * get("amplitude")
    table.add_row("leakage that 38 kPa drive through the gap", "", f"{LPM * conductance * 38e3:.5f} L/min")
    dragged = 0.5 * LPM * math.pi * diameter * gap * speed
    table.add_row("leakage that the plunger drags along at its highest speed", "", f"{dragged:.4f} L/min")
    pressure = 1e-6 * SPIKE / LPM / conductance
    table.add_row(f"pressure that would drive {SPIKE} L/min through the gap", "", f"{pressure:.1f} MPa")


def step_answers(table: Table, system) -> dict[str, float]:
    """The steady error that break-away friction of the cylinder leaves after the step."""
    changes = {"cylinder_breakaway_friction": np.array(BREAKAWAYS)}
    errors = np.abs(step_figures(system, changes)["steady"])
    for force, error in zip(BREAKAWAYS, errors, strict=True):
        table.add_row(f"steady error with a break-away force of {force:.0f} N", "", f"{error:.3f} mm")
    return {"breakaway_mm": float(errors[-1])}


def row(bench: PumpBench) -> dict[str, np.ndarray]:
    """A table whose only row is this bench."""
    return {"position_gain": np.array([float(edhas.get(bench, "position_gain"))])}


def first_harmonic(bench: PumpBench) -> tuple[float, float]:
    """Lag [°] and amplitude loss [%] of the first harmonic of the piston at 10 Hz."""
    position = settled_cycle(bench, row(bench), 10.0)[0]["piston_position"][:, 0]
    angle = 2.0 * np.pi * np.arange(SAMPLES) / SAMPLES
    harmonic = 2.0 / SAMPLES * np.sum(position * np.exp(-1j * angle))
    lag = -math.degrees(np.angle(1j * harmonic))
    return lag, 100.0 * (1.0 - abs(harmonic) / float(edhas.get(bench, "amplitude")))


def signals(bench: PumpBench, frequency: float) -> dict[str, np.ndarray]:
    """Every signal over one settled cycle."""
    cycles = math.ceil(RUN_IN * frequency) + 1
    settings = edhas.Simulation(duration=cycles / frequency, sample_rate=SAMPLES * frequency)
    run = edhas.simulate(edhas.change(bench, frequency=frequency), settings)
    return {n: v[-SAMPLES - 1 : -1] for n, v in run.signals.items()}


def backflow_share(flow: np.ndarray) -> float:
    """The flow in the wrong direction as a share of that in the right one [%]."""
    return 100.0 * -np.minimum(flow, 0.0).sum() / np.maximum(flow, 0.0).sum()


if __name__ == "__main__":
    main()
