"""Identification of LuGre friction from slow reversals and runs at constant speed.

    python -m studies.identification.friction [--out PICTURE]

The experiments of the paper's Figure 6 on the actuator bench: slow reversals within the presliding range, and strokes
at constant speeds. Current and position are simulated with noise for a machine with known friction; nonlinear least
squares, started from values that are wrong by 50 % and more, identifies its parameters.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

import edhas_jax as edhas
from edhas_jax.core.plot_style import COLOURS, INK
from edhas_jax.core.units import format_quantity
from edhas_jax.inference.fit.fit import Fit, fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.machine.components.set_points import Recorded
from edhas_jax.machine.effects import LugreFriction
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.unknown_parameters import UnknownParameter

TRUTH = {
    "coulomb_friction": 4.0, "static_friction": 6.0, "stribeck_velocity": 0.02, "bristle_stiffness": 1e5,
    "bristle_damping": 100.0, "viscous_friction": 2.0,
}  # fmt: skip
INITIAL_GUESS = {
    "coulomb_friction": 6.0, "static_friction": 9.0, "stribeck_velocity": 0.01, "bristle_stiffness": 5e4,
    "bristle_damping": 200.0, "viscous_friction": 4.0,
}  # fmt: skip
SPEEDS = (2e-3, 5e-3, 10e-3, 20e-3, 40e-3, 80e-3, 160e-3)  # m/s
CREEP_AMPLITUDES = (20e-6, 60e-6, 150e-6)  # m, peak, at 2 Hz
INTERVAL, SAMPLES = 1e-3, 1001  # s and count
MAX_AMPLITUDE = 4e-3  # m, of the runs at constant speed
CHANNELS = {"current": Channel("A", 0.01), "piston_position": Channel("mm", 1e-6)}


def rounded_triangle_wave(speed: float, time: np.ndarray) -> np.ndarray:
    """A set point [m] with constant speed [m/s] between rounded reversals, ramped up over the first 20 ms."""
    amplitude = min(MAX_AMPLITUDE, 0.2 * speed)
    quarters = speed * time / amplitude
    position = amplitude * (2.0 / np.pi) * np.arcsin(np.clip(0.995 * np.sin(0.5 * np.pi * quarters), -1.0, 1.0))
    return position * np.minimum(time / 0.02, 1.0)


def bench(friction: dict[str, float]):
    """The nominal bench with this friction and a recorded set point."""
    zero = Recorded(values=np.zeros(SAMPLES), interval=INTERVAL)
    return edhas.ActuatorBench(reference=zero, effects=(LugreFriction(**friction),))


def planned_campaign() -> Campaign:
    """All runs with their set points, without measurements."""
    time = INTERVAL * np.arange(SAMPLES)
    inputs = {f"{v * 1e3:g} mm/s": rounded_triangle_wave(v, time) for v in SPEEDS}
    creep = np.sin(4.0 * np.pi * time)
    inputs |= {f"creep {a * 1e6:g} µm": a * creep * np.minimum(time / 0.1, 1.0) for a in CREEP_AMPLITUDES}
    runs = tuple(
        BenchRun(name, Path(name), Use.FIT, {}, time, {}, np.arange(SAMPLES), Recorded(values=v, interval=INTERVAL))
        for name, v in inputs.items()
    )
    return Campaign("friction", Path("friction"), bench(INITIAL_GUESS), {}, CHANNELS, runs, ())


def add_measurements(campaign: Campaign, seed: int = 0) -> Campaign:
    """Simulate the measurements of the true bench with noise at a step that the fit does not use."""
    rng = np.random.default_rng(seed)
    model = MeasurementModel(campaign, bench(TRUTH), (), campaign.runs)
    outcomes = model.predict_all_runs(np.zeros(0), 100)
    runs = []
    for r, run in enumerate(campaign.runs):
        noisy = {n: v + CHANNELS[n].noise * rng.standard_normal(SAMPLES) for n, v in outcomes[r].values.items()}
        runs.append(dataclasses.replace(run, signals=noisy))
    return dataclasses.replace(campaign, runs=tuple(runs))


def identify(campaign: Campaign) -> Fit:
    """Fit all six parameters at once, without priors."""
    machine = campaign.machine
    unknowns = []
    for name in TRUTH:
        p, _ = find_parameter(machine, name)
        unknowns.append(
            UnknownParameter(name, float(get_parameter(machine, name)), 0.5, p.unit, p.span, has_prior=False)
        )
    return fit(FitProblem(campaign, machine, tuple(unknowns)), starts=np.zeros((1, len(unknowns))))


def draw(fitted: Fit):
    """Draw friction over speed (constant speeds) and over position (slow reversals), measured and identified."""
    from matplotlib.figure import Figure

    campaign, runs = fitted.problem.campaign, fitted.problem.campaign.runs
    machine, true = fitted.machine, bench(TRUTH)
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    model = MeasurementModel(
        campaign, machine, (), runs, signals=("friction_force", "piston_velocity", "piston_position")
    )
    predicted = model.predict_all_runs(np.zeros(0), 20)
    for r, speed in enumerate(SPEEDS):
        velocity = predicted[r].values["piston_velocity"]
        steady = (np.abs(np.abs(velocity) / speed - 1.0) < 0.03) & (runs[r].time > 0.1)
        for sign in (1.0, -1.0):
            selected = steady & (np.sign(velocity) == sign)
            if selected.sum() > 5:
                force = float(machine.coil.force_constant) * runs[r].signals["current"][selected].mean()
                friction = force - float(machine.mover.mover_damping) * velocity[selected].mean()
                left.plot(1e3 * sign * speed, friction, "o", ms=6, color=COLOURS[0], label="measured")
    v = np.linspace(-0.17, 0.17, 801)
    for m, colour, style, label in ((true, "#6e7781", "--", "true"), (machine, COLOURS[1], "-", "identified")):
        effect = m.effects[0]
        decay = 1.0 - np.exp(-((v / effect.stribeck_velocity) ** 2))
        level = effect.static_friction - (effect.static_friction - effect.coulomb_friction) * decay
        left.plot(1e3 * v, level * np.sign(v) + effect.viscous_friction * v, style, color=colour, label=label)
    for k, amplitude in enumerate(CREEP_AMPLITUDES):
        out = predicted[len(SPEEDS) + k].values
        late = runs[0].time > 0.5
        right.plot(1e6 * out["piston_position"][late], out["friction_force"][late], color=COLOURS[k + 1],
                   label=f"set point ± {format_quantity(amplitude, 'm')}")  # fmt: skip
    for axes, label in ((left, "speed, mm/s"), (right, "piston position, µm")):
        axes.set_xlabel(label, fontsize=9, color=INK)
        axes.set_ylabel("friction, N", fontsize=9, color=INK)
        axes.grid(True, color="#d8dee4", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        handles, labels = axes.get_legend_handles_labels()
        unique = dict(zip(labels, handles, strict=True))
        axes.legend(unique.values(), unique.keys(), fontsize=8, frameon=False)
    left.set_title("constant speed", fontsize=10, loc="left", color=INK)
    right.set_title("slow reversals, as identified", fontsize=10, loc="left", color=INK)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Print estimates and true values; draw the friction curves if asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, help="picture to write")
    out = parser.parse_args(arguments).out
    fitted = identify(add_measurements(planned_campaign()))
    worst_error = 0.0
    for name, value in fitted.values.items():
        unit = next(u.unit for u in fitted.problem.unknowns if u.name == name)
        error = fitted.standard_errors[name]
        deviation = (value - TRUTH[name]) / error
        worst_error = max(worst_error, abs(value / TRUTH[name] - 1.0))
        print(f"{name:20s} {format_quantity(value, unit):>14s} ± {format_quantity(error, unit):<12s} "
              f"true {format_quantity(TRUTH[name], unit):>12s}  {deviation:+.1f} σ")  # fmt: skip
    if out:
        draw(fitted).savefig(out, dpi=110)
    print(f"worst_relative_error={worst_error:.4f}")


if __name__ == "__main__":
    main()
