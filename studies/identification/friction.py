"""Can friction be identified on the bench? LuGre parameters from slow reversals and runs at constant speed.

    python -m studies.identification.friction [--out PICTURE]

The experiments of the paper's Figure 6 on the actuator bench: the piston creeps to and fro within the bending of the
bristles, and strokes at constant speeds. Current and position are recorded with noise from a machine with known
friction; least squares over the simulated runs, from starts that are wrong by half and more, returns its parameters.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np

import edhas_jax as edhas
from edhas_jax.core.plot_style import COLOURS, INK
from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.calibration.fit import Fit, FitProblem, fit
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
GUESS = {
    "coulomb_friction": 6.0, "static_friction": 9.0, "stribeck_velocity": 0.01, "bristle_stiffness": 5e4,
    "bristle_damping": 200.0, "viscous_friction": 4.0,
}  # fmt: skip
SPEEDS = (2e-3, 5e-3, 10e-3, 20e-3, 40e-3, 80e-3, 160e-3)  # m/s
CREEPS = (20e-6, 60e-6, 150e-6)  # m, peak, at 2 Hz
INTERVAL, SAMPLES, STROKE = 1e-3, 1001, 4e-3
CHANNELS = {"current": Channel("A", 0.01), "piston_position": Channel("mm", 1e-6)}


def stroke(speed: float, time: np.ndarray) -> np.ndarray:
    """To and fro at constant speed, at most over the stroke, starting softly."""
    reach = min(STROKE, 0.2 * speed)
    place = speed * time / reach
    way = reach * (2.0 / np.pi) * np.arcsin(np.clip(0.995 * np.sin(0.5 * np.pi * place), -1.0, 1.0))
    return way * np.minimum(time / 0.02, 1.0)


def bench(friction: dict[str, float]):
    """The bench with this friction, everything else nominal; its set point is recorded."""
    still = Recorded(values=np.zeros(SAMPLES), interval=INTERVAL)
    return edhas.ActuatorBench(reference=still, effects=(LugreFriction(**friction),))


def experiments() -> Campaign:
    """All runs, with nothing measured yet."""
    time = INTERVAL * np.arange(SAMPLES)
    inputs = {f"{v * 1e3:g} mm/s": stroke(v, time) for v in SPEEDS}
    inputs |= {f"creep {a * 1e6:g} µm": a * np.sin(4.0 * np.pi * time) * np.minimum(time / 0.1, 1.0) for a in CREEPS}
    runs = tuple(
        BenchRun(name, Path(name), Use.FIT, {}, time, {}, np.arange(SAMPLES), Recorded(values=v, interval=INTERVAL))
        for name, v in inputs.items()
    )
    return Campaign("friction", Path("friction"), bench(GUESS), {}, CHANNELS, runs, ())


def measure(campaign: Campaign, seed: int = 0) -> Campaign:
    """The runs as the true bench gives them, with noise, at a step that the fit does not use."""
    rng = np.random.default_rng(seed)
    model = MeasurementModel(campaign, bench(TRUTH), (), campaign.runs)
    outcomes = model.predict_all_runs(np.zeros(0), 100)
    runs = []
    for r, run in enumerate(campaign.runs):
        noisy = {n: v + CHANNELS[n].noise * rng.standard_normal(SAMPLES) for n, v in outcomes[r].values.items()}
        runs.append(dataclasses.replace(run, signals=noisy))
    return dataclasses.replace(campaign, runs=tuple(runs))


def identify(campaign: Campaign) -> Fit:
    """All six parameters at once, without any belief about their values."""
    machine = campaign.machine
    unknowns = []
    for name in TRUTH:
        p, _ = find_parameter(machine, name)
        unknowns.append(
            UnknownParameter(name, float(get_parameter(machine, name)), 0.5, p.unit, p.span, has_prior=False)
        )
    return fit(FitProblem(campaign, machine, tuple(unknowns)), starts=np.zeros((1, len(unknowns))))


def draw(found: Fit):
    """The friction over speed of the constant runs, and over travel of the slow reversals: measured and identified."""
    from matplotlib.figure import Figure

    campaign, runs = found.problem.campaign, found.problem.campaign.runs
    machine, true = found.machine, bench(TRUTH)
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    left, right = figure.subplots(1, 2)
    model = MeasurementModel(
        campaign, machine, (), runs, signals=("friction_force", "piston_velocity", "piston_position")
    )
    seen = model.predict_all_runs(np.zeros(0), 20)
    for r, speed in enumerate(SPEEDS):
        velocity = seen[r].values["piston_velocity"]
        steady = (np.abs(np.abs(velocity) / speed - 1.0) < 0.03) & (runs[r].time > 0.1)
        for sign in (1.0, -1.0):
            at = steady & (np.sign(velocity) == sign)
            if at.sum() > 5:
                force = float(machine.coil.force_constant) * runs[r].signals["current"][at].mean()
                friction = force - float(machine.mover.mover_damping) * velocity[at].mean()
                left.plot(1e3 * sign * speed, friction, "o", ms=6, color=COLOURS[0], label="measured")
    v = np.linspace(-0.17, 0.17, 801)
    for m, colour, style, label in ((true, "#6e7781", "--", "true"), (machine, COLOURS[1], "-", "identified")):
        e = m.effects[0]
        fallen = 1.0 - np.exp(-((v / e.stribeck_velocity) ** 2))
        level = e.static_friction - (e.static_friction - e.coulomb_friction) * fallen
        left.plot(1e3 * v, level * np.sign(v) + e.viscous_friction * v, style, color=colour, label=label)
    for k, amplitude in enumerate(CREEPS):
        out = seen[len(SPEEDS) + k].values
        late = runs[0].time > 0.5
        right.plot(1e6 * out["piston_position"][late], out["friction_force"][late], color=COLOURS[k + 1],
                   label=f"set point ± {format_quantity(amplitude, 'm')}")  # fmt: skip
    for axes, label in ((left, "speed, mm/s"), (right, "piston position, µm")):
        axes.set_xlabel(label, fontsize=9, color=INK)
        axes.set_ylabel("friction, N", fontsize=9, color=INK)
        axes.grid(True, color="#d8dee4", lw=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        handles, labels = axes.get_legend_handles_labels()
        once = dict(zip(labels, handles, strict=True))
        axes.legend(once.values(), once.keys(), fontsize=8, frameon=False)
    left.set_title("constant speed", fontsize=10, loc="left", color=INK)
    right.set_title("slow reversals, as identified", fontsize=10, loc="left", color=INK)
    return figure


def main(arguments: list[str] | None = None) -> None:
    """Print the parameters beside the truth; draw them if asked."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--out", type=Path, help="picture to write")
    out = parser.parse_args(arguments).out
    found = identify(measure(experiments()))
    worst = 0.0
    for name, value in found.values.items():
        unit = next(u.unit for u in found.problem.unknowns if u.name == name)
        error = found.standard_errors[name]
        off = (value - TRUTH[name]) / error
        worst = max(worst, abs(value / TRUTH[name] - 1.0))
        print(f"{name:20s} {format_quantity(value, unit):>14s} ± {format_quantity(error, unit):<12s} "
              f"true {format_quantity(TRUTH[name], unit):>12s}  {off:+.1f} σ")  # fmt: skip
    if out:
        draw(found).savefig(out, dpi=110)
    print(f"worst_relative_error={worst:.4f}")


if __name__ == "__main__":
    main()
