"""Which controller for the piston? PID, cascade and ANTSMC under load, disturbed, in continuous time and sampled.

    python -m studies.controllers [--short] [--out FOLDER]

Each is tuned at 10 and 30 Hz under load and with two steps, by the same objective, optimiser and budget
(`studies.controllers.tuning`), once in continuous time and once as a 5 kHz computer runs it whose command comes one
sample late. The gains then stay as they are: tracking from 1 to 60 Hz, a heavier load, a heavier mover, more friction,
a step of the set point, a step of the load, other sample times. The last line has the rms tracking errors in µm,
`_5khz` for the sampled ones.
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
from studies.controllers.pictures import picture
from studies.controllers.tuning import Budget, Task, Tuned, tune

CONFIG = CONFIGS / "paper.yaml"
LOAD = 2e-6  # m² of the load orifice: about 0.12 MPa at 10 Hz and 1.1 MPa at 30 Hz
LAG = 1e-4  # s, of the inverter: without it nothing but the computer would keep gains from growing for ever
CONTROLLERS = {
    "pid": (PositionController(), ("position_gain", "integral_gain", "velocity_gain", "emf_feedforward")),
    "cascade": (CascadeController(), ("cascade_position_gain", "cascade_velocity_gain")),
    "antsmc": (
        AdaptiveSlidingMode(),
        ("surface_rate", "reaching_gain", "boundary_layer", "adaptation_gain", "adaptation_leak", "observer_rate",
         "current_time"),
    ),
}  # fmt: skip
SAMPLE = 2e-4
SAMPLINGS = {"continuous": Continuous(), "5khz": Sampled(sample_time=SAMPLE, computation_delay=SAMPLE)}
HOW = {"continuous": "cont.", "5khz": "5 kHz"}
MACHINE, FRICTION = edhas.PumpBench(), LugreFriction()
HEAVIER = {"mover_mass": 1.3 * MACHINE.mover.mover_mass, "plunger_mass": 1.3 * MACHINE.pump.plunger_mass}
ROUGHER = {n: 2.0 * getattr(FRICTION, n) for n in ("coulomb_friction", "static_friction", "viscous_friction")}
CONDITIONS = {
    "nominal": {},
    "load orifice halved": {"load_orifice_area": 0.5 * LOAD},
    "mass +30 %": HEAVIER,
    "friction doubled": ROUGHER,
    "mass and friction": HEAVIER | ROUGHER,
}
TUNED_AT = (10.0, 30.0)
# with half the mass the loop has 6 dB more gain: who has no margin is found out
LIGHTER = {
    "mover_mass": np.array([1.0, 0.5]) * MACHINE.mover.mover_mass,
    "plunger_mass": np.array([1.0, 0.5]) * MACHINE.pump.plunger_mass,
}
SINES = {"frequency": np.tile(TUNED_AT, 2)} | {n: np.repeat(v, 2) for n, v in LIGHTER.items()}
STEP_SIZE, STEP_TIME, LOAD_TIME, END = 1e-3, 5e-3, 45e-3, 80e-3
Key = tuple[str, str]


class LoadStep(Effect):
    """A force that pushes the piston back from some time on.

    Source: this study.
    """

    pushing_force: float = par(50.0, "N", (-1e4, 1e4), "force")
    pushing_time: float = par(LOAD_TIME, "s", (0.0, 1e3), "when it begins")

    def mover_force(self, s, z):
        return jnp.where(s.time >= self.pushing_time, -self.pushing_force, 0.0) + 0.0 * s.piston_velocity


@dataclasses.dataclass(frozen=True)
class Findings:
    """What was measured of each controller, by (controller, sampling).

    `errors` (conditions, frequencies of the tuning) and `tracking` (frequencies) are rms errors [m]; `traces` are time
    [s], set point and piston position [m] of the two steps; `sampled` are rms errors at 30 Hz over `sample_times`.
    """

    tuned: dict[Key, Tuned]
    errors: dict[Key, np.ndarray]
    frequencies: np.ndarray
    tracking: dict[Key, np.ndarray]
    traces: dict[Key, tuple[np.ndarray, np.ndarray, np.ndarray]]
    sample_times: np.ndarray
    sampled: dict[str, np.ndarray]


def main(arguments: list[str] | None = None) -> dict[str, float]:
    """Tune, disturb, print the table and the errors, leave the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--short", action="store_true", help="a taste of it: two controllers, sampled, hardly tuned")
    parser.add_argument("--out", type=Path, default=Path("runs/controllers"))
    options = parser.parse_args(arguments)
    budget = Budget(drawn=1, starts=1, iterations=2, steps_per_cycle=1250, cycles=2) if options.short else Budget()
    keys = [(name, how) for name in CONTROLLERS for how in SAMPLINGS]
    if options.short:
        keys = [("pid", "5khz"), ("cascade", "5khz")]
    found = study(keys, budget, 3 if options.short else 25)
    options.out.mkdir(parents=True, exist_ok=True)
    picture(found, CONDITIONS, LOAD_TIME).savefig(options.out / "controllers.png", dpi=130)
    console = Console(highlight=False)
    for key, tuned in found.tuned.items():
        gains = ", ".join(f"{n} {v:.4g}" for n, v in tuned.gains.items())
        console.print(f"{key[0]}, {key[1]}: J {tuned.objective:.3f}; {gains}", soft_wrap=True)
    console.print(table(found))
    summary = {}
    for condition, suffix in (("nominal", ""), ("mass and friction", "_disturbed")):
        row = list(CONDITIONS).index(condition)
        for (name, sampling), errors in found.errors.items():
            for f, error in zip(TUNED_AT, errors[row], strict=True):
                tail = "" if sampling == "continuous" else f"_{sampling}"
                summary[f"{name}_{f:.0f}{suffix}{tail}"] = 1e6 * float(error)
    print(" ".join(f"{n}={v:.3g}" for n, v in summary.items()))
    return summary


def study(keys: list[Key], budget: Budget, points: int) -> Findings:
    """Everything that is measured."""
    base = edhas.change(edhas.load(CONFIG).machine, load_orifice_area=LOAD)
    base = structs.replace(base, effects=(*base.effects, AmplifierLag(amplifier_time=LAG)))
    frequencies = np.unique(np.r_[np.geomspace(1.0, 60.0, points), TUNED_AT])
    sample_times = np.geomspace(5e-5, 8e-4, points)
    tuned, errors, tracking, traces, sampled = {}, {}, {}, {}, {}
    with Progress(transient=True) as progress:
        bar = progress.add_task("", total=len(keys))
        for done, (name, how) in enumerate(keys):
            progress.update(bar, description=f"{name}, {how}")
            controller, gains = CONTROLLERS[name]
            machine = structs.replace(base, controller=controller, sampling=SAMPLINGS[how])
            task, key = Task(machine, SINES, with_steps(machine), LIGHTER), (name, how)
            tuned[key] = tune(
                task, gains, budget, lambda share, done=done: progress.update(bar, completed=done + 0.8 * share)
            )
            machine = edhas.change(machine, **tuned[key].gains)
            errors[key], tracking[key], slower = rms_errors(machine, frequencies, sample_times)
            if slower is not None:
                sampled[name] = slower
            traces[key] = steps(machine)
            progress.update(bar, completed=done + 1)
    return Findings(tuned, errors, frequencies, tracking, traces, sample_times, sampled)


def rms_errors(machine, frequencies, sample_times) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The rms tracking errors [m] under every condition, over the frequency, and over the sample time if it has one."""
    rows = [{**changes, "frequency": f} for changes in CONDITIONS.values() for f in TUNED_AT]
    rows += [{"frequency": f} for f in frequencies]
    sampled = isinstance(machine.sampling, Sampled)
    if sampled:
        rows += [{"sample_time": t, "computation_delay": t, "frequency": TUNED_AT[1]} for t in sample_times]
    changed = {n for row in rows for n in row}
    columns = {n: np.array([float(row.get(n, edhas.get(machine, n))) for row in rows]) for n in changed}
    settings = BatchSettings(step=1e-5, tolerance=1e-3, max_cycles=10)
    error = run_designs(machine, columns, settings)["tracking_error"]
    disturbed, tracking, slower = np.split(error, np.cumsum([len(CONDITIONS) * len(TUNED_AT), len(frequencies)]))
    return disturbed.reshape(len(CONDITIONS), len(TUNED_AT)), tracking, slower if sampled else None


def with_steps(machine):
    """The machine under a step of the set point and, later, of the load."""
    reference = edhas.Step(step_size=STEP_SIZE, step_time=STEP_TIME)
    return structs.replace(machine, reference=reference, effects=(*machine.effects, LoadStep()))


def steps(machine) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time [s], set point and piston position [m] under the two steps."""
    run = edhas.simulate(with_steps(machine), edhas.Simulation(duration=END, step=1e-5, sample_rate=2e4))
    return run.signals["time"], run.signals["reference"], run.signals["piston_position"]


def table(found: Findings) -> Table:
    """The rms errors of all, a row per condition and frequency, then what the two steps show."""
    out = Table(title="under load, after tuning")
    out.add_column("rms error, µm", no_wrap=True)
    for name, how in found.errors:
        out.add_column(f"{name}\n{HOW[how]}", justify="right", no_wrap=True)
    for row, condition in enumerate(CONDITIONS):
        for column, f in enumerate(TUNED_AT):
            out.add_row(f"{condition}, {f:.0f} Hz", *[f"{1e6 * e[row, column]:.3g}" for e in found.errors.values()])
    out.add_section()
    for n, what in enumerate(("step, rise in ms", "step, overshoot in %", "50 N at rest, deviation in µm")):
        out.add_row(what, *[f"{shown(*trace)[n]:.3g}" for trace in found.traces.values()])
    return out


def shown(time, reference, position) -> tuple[float, float, float]:
    """Rise time [ms], overshoot [%] and the largest deviation after the step of the load [µm]."""
    before = (time >= STEP_TIME) & (time < LOAD_TIME)
    share = position[before] / STEP_SIZE
    low, high = (int(np.argmax(share >= level)) for level in (0.1, 0.9))
    rise = 1e3 * (time[high] - time[low]) if share.max() >= 0.9 else np.nan
    rest = position[before][-1]
    return rise, 100.0 * max(share.max() - 1.0, 0.0), 1e6 * np.abs(position[time >= LOAD_TIME] - rest).max()
