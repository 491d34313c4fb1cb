"""Comparison of PID, cascade and ANTSMC piston controllers under load, disturbed, in continuous time and sampled.

    python -m studies.controllers [--short] [--out FOLDER]

Each controller is tuned at 10 and 30 Hz under load and with two steps, with the same objective, optimiser and budget
(`studies.controllers.tuning`), once in continuous time and once sampled at 5 kHz with one sample of delay. With these
gains the study computes the tracking from 1 to 60 Hz, the effect of a heavier load, a heavier mover and more friction,
the responses to a step of the set point and of the load, and the effect of other sample times. The last line has the
rms tracking errors in µm; the suffix `_5khz` marks the sampled controllers.
"""

import argparse
import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.design.batch.batch import BatchSettings, run_designs
from edhas_jax.machine.components.adaptive_sliding_mode import AdaptiveSlidingMode
from edhas_jax.machine.components.controller_sampling import Continuous, Sampled
from edhas_jax.machine.components.controllers import CascadeController, PositionController
from edhas_jax.machine.effects import AmplifierLag, Effect, LugreFriction
from studies import CONFIGS
from studies.controllers.pictures import draw_comparison
from studies.controllers.tuning import Budget, TunedGains, TuningTask, tune

CONFIG = CONFIGS / "paper.yaml"
LOAD_ORIFICE_AREA = 2e-6  # m²; load pressure about 0.12 MPa at 10 Hz and 1.1 MPa at 30 Hz
INVERTER_TIME = 1e-4  # s, time constant; without it only sampling would limit the gains
CONTROLLERS = {
    "pid": (PositionController(), ("position_gain", "integral_gain", "velocity_gain", "emf_feedforward")),
    "cascade": (CascadeController(), ("cascade_position_gain", "cascade_velocity_gain")),
    "antsmc": (
        AdaptiveSlidingMode(),
        ("surface_rate", "reaching_gain", "boundary_layer", "adaptation_gain", "adaptation_leak", "observer_rate",
         "current_time"),
    ),
}  # fmt: skip
SAMPLE_TIME = 2e-4  # s
SAMPLINGS = {"continuous": Continuous(), "5khz": Sampled(sample_time=SAMPLE_TIME, computation_delay=SAMPLE_TIME)}
SAMPLING_LABELS = {"continuous": "cont.", "5khz": "5 kHz"}
NOMINAL_MACHINE, NOMINAL_FRICTION = edhas.PumpBench(), LugreFriction()
HEAVIER_MOVER = {
    "mover_mass": 1.3 * NOMINAL_MACHINE.mover.mover_mass,
    "plunger_mass": 1.3 * NOMINAL_MACHINE.pump.plunger_mass,
}
DOUBLED_FRICTION = {
    n: 2.0 * getattr(NOMINAL_FRICTION, n) for n in ("coulomb_friction", "static_friction", "viscous_friction")
}
CONDITIONS = {
    "nominal": {},
    "load orifice halved": {"load_orifice_area": 0.5 * LOAD_ORIFICE_AREA},
    "mass +30 %": HEAVIER_MOVER,
    "friction doubled": DOUBLED_FRICTION,
    "mass and friction": HEAVIER_MOVER | DOUBLED_FRICTION,
}
TUNING_FREQUENCIES = (10.0, 30.0)  # Hz
# half the mass raises the loop gain by 6 dB, so that tuning keeps a gain margin
MASS_VARIANTS = {
    "mover_mass": np.array([1.0, 0.5]) * NOMINAL_MACHINE.mover.mover_mass,
    "plunger_mass": np.array([1.0, 0.5]) * NOMINAL_MACHINE.pump.plunger_mass,
}
TUNING_SINES = {"frequency": np.tile(TUNING_FREQUENCIES, 2)} | {n: np.repeat(v, 2) for n, v in MASS_VARIANTS.items()}
STEP_SIZE = 1e-3  # m
STEP_TIME, LOAD_STEP_TIME, STEP_RUN_DURATION = 5e-3, 45e-3, 80e-3  # s
ControllerKey = tuple[str, str]  # controller and sampling


class LoadStep(Effect):
    """A constant force on the piston in negative direction from a given time on.

    Source: this study.
    """

    pushing_force: float = par(50.0, "N", (-1e4, 1e4), "force")
    pushing_time: float = par(LOAD_STEP_TIME, "s", (0.0, 1e3), "time at which it begins")

    def mover_force(self, s, z):
        return jnp.where(s.time >= self.pushing_time, -self.pushing_force, 0.0) + 0.0 * s.piston_velocity


@dataclasses.dataclass(frozen=True)
class Comparison:
    """The results of every controller, by (controller, sampling).

    Attributes:
        tuned: gains and objective.
        condition_errors: rms tracking errors [m], shape (conditions, tuning frequencies).
        frequencies: frequencies [Hz] of `tracking_errors`.
        tracking_errors: rms tracking errors [m] under nominal conditions, shape (frequencies,).
        step_responses: time [s], set point [m] and piston position [m] under both steps.
        sample_times: sample times [s] of `sample_time_errors`.
        sample_time_errors: by controller, rms tracking errors [m] at 30 Hz, shape (sample times,).
    """

    tuned: dict[ControllerKey, TunedGains]
    condition_errors: dict[ControllerKey, np.ndarray]
    frequencies: np.ndarray
    tracking_errors: dict[ControllerKey, np.ndarray]
    step_responses: dict[ControllerKey, tuple[np.ndarray, np.ndarray, np.ndarray]]
    sample_times: np.ndarray
    sample_time_errors: dict[str, np.ndarray]


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Tune and compare the controllers; print the table and the errors, write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="two sampled controllers with two iterations of tuning")
    parser.add_argument("--out", type=Path, default=Path("runs/controllers"))
    options = parser.parse_args(arguments)
    budget = Budget(candidates=1, starts=1, iterations=2, steps_per_cycle=1250, cycles=2) if options.short else Budget()
    keys = [(name, sampling) for name in CONTROLLERS for sampling in SAMPLINGS]
    if options.short:
        keys = [("pid", "5khz"), ("cascade", "5khz")]
    comparison = compare_controllers(keys, budget, 3 if options.short else 25)
    options.out.mkdir(parents=True, exist_ok=True)
    draw_comparison(comparison, CONDITIONS, LOAD_STEP_TIME).savefig(options.out / "controllers.png", dpi=130)
    console = Console(highlight=False)
    for (name, sampling), tuned in comparison.tuned.items():
        gains = ", ".join(f"{n} {v:.4g}" for n, v in tuned.gains.items())
        console.print(f"{name}, {sampling}: J {tuned.objective:.3f}; {gains}", soft_wrap=True)
    console.print(results_table(comparison))
    summary = {}
    for condition, suffix in (("nominal", ""), ("mass and friction", "_disturbed")):
        row = list(CONDITIONS).index(condition)
        for (name, sampling), errors in comparison.condition_errors.items():
            for f, error in zip(TUNING_FREQUENCIES, errors[row], strict=True):
                tail = "" if sampling == "continuous" else f"_{sampling}"
                summary[f"{name}_{f:.0f}{suffix}{tail}"] = 1e6 * float(error)
    print(" ".join(f"{n}={v:.3g}" for n, v in summary.items()))
    return summary


def compare_controllers(keys: list[ControllerKey], budget: Budget, points: int) -> Comparison:
    """Tune every controller and compute its errors and step responses.

    Args:
        keys: the controllers and samplings.
        budget: effort of the tuning.
        points: number of frequencies and of sample times.
    """
    base = edhas.change(edhas.load(CONFIG).machine, load_orifice_area=LOAD_ORIFICE_AREA)
    base = structs.replace(base, effects=(*base.effects, AmplifierLag(amplifier_time=INVERTER_TIME)))
    frequencies = np.unique(np.r_[np.geomspace(1.0, 60.0, points), TUNING_FREQUENCIES])
    sample_times = np.geomspace(5e-5, 8e-4, points)
    tuned, condition_errors, tracking_errors, step_responses, sample_time_errors = {}, {}, {}, {}, {}
    with Progress(transient=True) as progress:
        bar = progress.add_task("", total=len(keys))
        for done, (name, sampling) in enumerate(keys):
            progress.update(bar, description=f"{name}, {sampling}")
            controller, gains = CONTROLLERS[name]
            machine = structs.replace(base, controller=controller, sampling=SAMPLINGS[sampling])
            task = TuningTask(machine, TUNING_SINES, with_step_inputs(machine), MASS_VARIANTS)
            key = (name, sampling)
            tuned[key] = tune(
                task, gains, budget, lambda share, done=done: progress.update(bar, completed=done + 0.8 * share)
            )
            machine = edhas.change(machine, **tuned[key].gains)
            condition_errors[key], tracking_errors[key], by_sample_time = rms_errors(machine, frequencies, sample_times)
            if by_sample_time is not None:
                sample_time_errors[name] = by_sample_time
            step_responses[key] = simulate_steps(machine)
            progress.update(bar, completed=done + 1)
    return Comparison(
        tuned, condition_errors, frequencies, tracking_errors, step_responses, sample_times, sample_time_errors
    )


def rms_errors(machine, frequencies, sample_times) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Rms tracking errors [m]: (conditions, tuning frequencies), (frequencies,) and, if sampled, (sample times,)."""
    rows = [{**changes, "frequency": f} for changes in CONDITIONS.values() for f in TUNING_FREQUENCIES]
    rows += [{"frequency": f} for f in frequencies]
    sampled = isinstance(machine.sampling, Sampled)
    if sampled:
        rows += [{"sample_time": t, "computation_delay": t, "frequency": TUNING_FREQUENCIES[1]} for t in sample_times]
    changed = {n for row in rows for n in row}
    columns = {n: np.array([float(row.get(n, edhas.get(machine, n))) for row in rows]) for n in changed}
    settings = BatchSettings(step=1e-5, tolerance=1e-3, max_cycles=10)
    error = run_designs(machine, columns, settings)["tracking_error"]
    shape = (len(CONDITIONS), len(TUNING_FREQUENCIES))
    by_condition, tracking, by_sample_time = np.split(error, np.cumsum([shape[0] * shape[1], len(frequencies)]))
    return by_condition.reshape(shape), tracking, by_sample_time if sampled else None


def with_step_inputs(machine):
    """The machine under a step of the set point followed by a step of the load."""
    reference = edhas.Step(step_size=STEP_SIZE, step_time=STEP_TIME)
    return structs.replace(machine, reference=reference, effects=(*machine.effects, LoadStep()))


def simulate_steps(machine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], set point and piston position [m] under the two steps."""
    settings = edhas.Simulation(duration=STEP_RUN_DURATION, step=1e-5, sample_rate=2e4)
    run = edhas.simulate(with_step_inputs(machine), settings)
    return run.signals["time"], run.signals["reference"], run.signals["piston_position"]


def results_table(comparison: Comparison) -> Table:
    """The rms errors, a row per condition and frequency, and the metrics of the step responses, as a rich table."""
    rows = Table(title="under load, after tuning")
    rows.add_column("rms error, µm", no_wrap=True)
    for name, sampling in comparison.condition_errors:
        rows.add_column(f"{name}\n{SAMPLING_LABELS[sampling]}", justify="right", no_wrap=True)
    for row, condition in enumerate(CONDITIONS):
        for column, f in enumerate(TUNING_FREQUENCIES):
            errors = [f"{1e6 * e[row, column]:.3g}" for e in comparison.condition_errors.values()]
            rows.add_row(f"{condition}, {f:.0f} Hz", *errors)
    rows.add_section()
    metrics = [step_metrics(*response) for response in comparison.step_responses.values()]
    for n, label in enumerate(("step, rise in ms", "step, overshoot in %", "50 N at rest, deviation in µm")):
        rows.add_row(label, *[f"{values[n]:.3g}" for values in metrics])
    return rows


def step_metrics(time, reference, position) -> tuple[float, float, float]:
    """Rise time 10 … 90 % [ms], overshoot [%] and largest deviation after the step of the load [µm]."""
    before = (time >= STEP_TIME) & (time < LOAD_STEP_TIME)
    share = position[before] / STEP_SIZE
    low, high = (int(np.argmax(share >= level)) for level in (0.1, 0.9))
    rise = 1e3 * (time[high] - time[low]) if share.max() >= 0.9 else np.nan
    rest = position[before][-1]
    return rise, 100.0 * max(share.max() - 1.0, 0.0), 1e6 * np.abs(position[time >= LOAD_STEP_TIME] - rest).max()
