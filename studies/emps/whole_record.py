"""What `edhas diagnose` says about the EMPS campaign as it is, and with the controller that the record shows.

    python -m studies.emps.whole_record FOLDER

FOLDER holds the campaign of the EMPS data set, see `studies.emps.published_comparison`. Nothing is prepared: the model
is a mass alone, the first two thirds of the record are fitted and the last third is held out, as the diagnosis divides
a campaign of one run.

The control law u = kv (kp (r − x) − v) of the campaign can be compared with the record without any model of the
machine. The recorded command agrees with it only if the speed v is taken from a moment earlier. The study finds this
delay by least squares, and repeats the diagnosis with a controller whose measured speed lags by as much.

Force error: 100 ‖F − F_model‖/‖F‖ of the simulated closed loop on the part held out, both low-pass filtered at 20 Hz,
with the estimated deviations of the bench and without them. The last table lists those deviations that the runs show
clearly.
The friction is the force at constant speed by the law of the library alone, also where the final model adds a curve.
The last line of the output gives force errors in % and the friction [N] at 60 and at 120 mm/s (`friction_60`,
`friction_120`); names that end in `_late` are for the controller whose measured speed lags:
`speed_delay_ms=… gain_at_once=… gain_late=… first=… second=… mass=… mass_late=… friction_60=… friction_60_late=…
friction_120=… friction_120_late=… voltage_gain=… voltage_gain_late=… force_error=… force_error_late=…`
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar
from scipy.signal import butter, filtfilt

from edhas_jax import Controller
from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.report.bench_findings import bench_rows
from edhas_jax.diagnosis.report.report import parameter_texts
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.inference.likelihood.bench_deviations import DeviationKind
from edhas_jax.machine.components.controllers import CascadeController
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.comparison import compare
from studies.emps.discovery import force_errors, relative_error

FRICTION, SHOWN_SPEEDS = "lugre_friction", (0.06, 0.12)  # m/s; the drive moves at up to 0.125 m/s
MAX_DELAY = 5e-3  # s
COMPARISON_CUTOFF = 100.0  # Hz; above it, the speed calculated from the recorded position is mostly noise
ENDS_LEFT_OUT = 0.2  # s


class LateSpeedCascade(Controller):
    """A cascade whose measured speed lags behind the true one: u = kv (kp (r − x) − w), ẇ = (v − w)/T."""

    cascade_position_gain: float = par(160.0, "1/s", (0.0, 1e6), "gain of the position loop kp")
    cascade_velocity_gain: float = par(240.0, "V*s/m", (0.0, 1e7), "gain of the velocity loop kv")
    speed_lag: float = par(1e-3, "s", (1e-6, 1.0), "lag of the measured speed T")

    def initial(self) -> dict:
        """The measured speed [m/s]."""
        return {"measured_speed": 0.0}

    def command(self, y: dict, s):
        """The command u [V]."""
        speed_set_point = self.cascade_position_gain * (s.reference - s.piston_position)
        return self.cascade_velocity_gain * (speed_set_point - y["measured_speed"])

    def rates(self, y: dict, s) -> dict:
        """dw/dt [m/s²]."""
        return {"measured_speed": (s.piston_velocity - y["measured_speed"]) / self.speed_lag}


class LawFit(NamedTuple):
    """The recorded command over that of the control law: delay of the speed [s], gain, rms of the difference [V]."""

    delay: float
    gain: float
    rms: float


def compare_law(run: BenchRun, law: CascadeController, delay: float) -> LawFit:
    """Compare the recorded command with that of the control law in which the speed is delayed.

    Args:
        run: recorded set point, position and command.
        law: the gains.
        delay: of the speed [s].

    Returns:
        The gain by least squares, with an offset, and the rms of what is left.
    """
    time, position = run.time, CubicSpline(run.time, run.signals["piston_position"])
    set_point = run.reference.values[: len(time)]
    speed_set_point = law.cascade_position_gain * (set_point - position(time))
    command = law.cascade_velocity_gain * (speed_set_point - position(time - delay, 1))
    b, a = butter(4, 2.0 * COMPARISON_CUTOFF * run.interval)
    used = (time > time[0] + ENDS_LEFT_OUT) & (time < time[-1] - ENDS_LEFT_OUT)
    recorded, expected = (filtfilt(b, a, v)[used] for v in (run.signals["voltage"], command))
    columns = np.column_stack([expected, np.ones(len(expected))])
    coefficients = np.linalg.lstsq(columns, recorded, rcond=None)[0]
    return LawFit(delay, float(coefficients[0]), float(np.sqrt(np.mean((recorded - columns @ coefficients) ** 2))))


def speed_delay(run: BenchRun, law: CascadeController) -> LawFit:
    """The delay of the speed with which the control law agrees best with the recorded command."""
    found = minimize_scalar(
        lambda delay: compare_law(run, law, delay).rms, bounds=(-MAX_DELAY, MAX_DELAY), method="bounded"
    )
    return compare_law(run, law, float(found.x))


def with_late_speed(campaign: Campaign, delay: float) -> Campaign:
    """The campaign with a controller whose measured speed lags behind the true one by `delay` [s]."""
    law = campaign.machine.controller
    late = LateSpeedCascade(
        cascade_position_gain=law.cascade_position_gain, cascade_velocity_gain=law.cascade_velocity_gain,
        speed_lag=delay,
    )  # fmt: skip
    return dataclasses.replace(campaign, machine=structs.replace(campaign.machine, controller=late))


def force_error_without_deviations(campaign: Campaign, diagnosis: Diagnosis) -> float:
    """100 ‖F − F_model‖/‖F‖ [%] of the fitted model on the part held out, without any deviation of the bench."""
    fit = diagnosis.after.fit
    (run,) = fit.problem.campaign.runs_for(Use.HOLDOUT)
    whole = compare(campaign, fit.machine, fit.instruments).runs[0]
    held_out = np.isin(whole.run.lines, run.lines[np.isfinite(run.signals["voltage"])])
    measured, model = whole.run.signals["voltage"][held_out], whole.model["voltage"][held_out]
    return relative_error(measured - model, measured, run.interval)


def voltage_gain(diagnosis: Diagnosis) -> float:
    """What the diagnosis estimates for the gain error of the voltage sensor."""
    after = diagnosis.after
    rows = after.bench.deviations(after.fit.problem.bench)
    return next(
        (row.value * row.deviation.std for row in rows
         if row.deviation.kind is DeviationKind.GAIN and row.deviation.name == "voltage"), 0.0,
    )  # fmt: skip


class Friction(NamedTuple):
    """The friction in the final model of a diagnosis, by the law of the library alone.

    Args:
        forces: steady friction [N] at `SHOWN_SPEEDS`.
        parameters: the parameters with standard errors, as texts.
    """

    forces: list[float]
    parameters: list[str]


def found_friction(diagnosis: Diagnosis) -> Friction:
    """The friction in the final model of a diagnosis; its forces are NaN if this model has no friction."""
    friction = next((c for c in diagnosis.named if c.id == FRICTION), None)
    if friction is None:
        return Friction([np.nan] * len(SHOWN_SPEEDS), ["not in the final model"])
    fit = diagnosis.fit_of_parameters(friction)
    coulomb, static, viscous, speed = (
        fit.values[f"{FRICTION}.{name}"]
        for name in ("coulomb_friction", "static_friction", "viscous_friction", "stribeck_velocity")
    )
    forces = [coulomb + (static - coulomb) * np.exp(-((v / speed) ** 2)) + viscous * v for v in SHOWN_SPEEDS]
    return Friction(forces, parameter_texts(friction, fit))


def main(arguments: list[str] | None = None) -> None:
    """Compare the control law with the record, run both diagnoses and print what they say."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="campaign of the EMPS data set")
    campaign = read_campaign(parser.parse_args(arguments).folder)
    console = Console(highlight=False, width=150)
    run, law = campaign.runs[0], campaign.machine.controller
    at_once, late = compare_law(run, law, 0.0), speed_delay(run, law)
    table = Table("speed in the control law", "recorded command over expected one", "rms of the difference")
    for name, row in (("at once", at_once), (f"{1e3 * late.delay:.2f} ms late", late)):
        table.add_row(name, f"{row.gain:.4f}", f"{1e3 * row.rms:.1f} mV")
    console.print(table)
    found = {}
    with console.status("") as status:
        for name, what in (("at once", campaign), ("late", with_late_speed(campaign, late.delay))):
            found[name] = diagnose(what, on_progress=status.update)
    table = Table("speed", "effects", "mass", "friction at 60 and 120 mm/s", "gain error of the voltage",
                  "residual over noise, held out", "force error, held out", "without deviations")  # fmt: skip
    figures = {}
    for name, diagnosis in found.items():
        values, effects = diagnosis.after.fit.values, [c.id for c in diagnosis.named]
        friction = found_friction(diagnosis)
        errors = force_errors(diagnosis.after)[Use.HOLDOUT], force_error_without_deviations(campaign, diagnosis)
        gain, probability = voltage_gain(diagnosis), diagnosis.posterior.probabilities[diagnosis.first]
        figures[name] = effects, values["mover_mass"], friction, gain, errors
        table.add_row(
            name, f"{' + '.join(effects)} ({diagnosis.verdict.value}, {probability:.2f})",
            f"{values['mover_mass']:.2f} kg", " and ".join(f"{force:.1f} N" for force in friction.forces),
            f"{100.0 * gain:+.2f} %",
            f"{diagnosis.after.rms_over_noise(Use.HOLDOUT):.2f}", *(f"{e:.2f} %" for e in errors),
        )  # fmt: skip
    console.print(table)
    for name, row in figures.items():
        console.print(f"friction, speed {name}: {', '.join(row[2].parameters)}")
    table = Table("speed", "what the bench did", "run", "deviation", "accuracy")
    for name, diagnosis in found.items():
        for row in bench_rows(diagnosis.after):
            table.add_row(name, *row)
    console.print(table)
    effects = [*figures["at once"][0], "none", "none"]
    one, other = figures["at once"], figures["late"]
    print(
        f"speed_delay_ms={1e3 * late.delay:.3f} gain_at_once={at_once.gain:.4f} gain_late={late.gain:.4f} "
        f"first={effects[0]} second={effects[1]} mass={one[1]:.2f} mass_late={other[1]:.2f} "
        f"friction_60={one[2].forces[0]:.1f} friction_60_late={other[2].forces[0]:.1f} "
        f"friction_120={one[2].forces[1]:.1f} friction_120_late={other[2].forces[1]:.1f} "
        f"voltage_gain={one[3]:.4f} voltage_gain_late={other[3]:.4f} "
        f"force_error={one[4][0]:.2f} force_error_late={other[4][0]:.2f}"
    )


if __name__ == "__main__":
    main()
