"""Identification of a linear drive with friction: errors on the EMPS benchmark next to the published ones.

    python -m studies.emps FOLDER

FOLDER holds the campaign of the EMPS data set (A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS,
Workshop on Nonlinear System Identification Benchmarks, 2019), which is not part of this project.

Force error: 100 ‖F − F_model‖/‖F‖ of the inverse dynamics, by least squares with speed and acceleration from the
filtered position. Closed loop: rms position error of the simulated loop with fitted parameters, once with the stated
controller gains and once with gains fitted within 2 %. The gains matter: at speed v the piston lags by v/kp, which
changes by 6 µm for 1 % of kp at 0.1 m/s. The drive's controller computes its speed from position differences, the
continuous loop of the model does not. The record starts in motion and the model at rest, so the first 0.1 s are not
evaluated.
"""

import argparse
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, filtfilt

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.inference.fit.fit import Fit, fit
from edhas_jax.inference.fit.fit_problem import FitProblem
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.measurements.campaign import Campaign, Spread
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.unknown_parameters import (
    ParameterScale,
    UnknownParameter,
    uncertain_unknowns,
    unknown_around,
)

EVALUATION_START = 0.1  # s; the record starts in motion, the model at rest
POSITION_CUTOFF, FORCE_CUTOFF = 50.0, 20.0  # Hz, zero-phase; the second on both sides of the regression
# model: force error [%] and closed-loop error [µm]
PUBLISHED = {
    "mass alone": (69.5, 27.5), "viscous, offset": (17.0, 6.66), "Coulomb, offset": (15.1, 6.14),
    "viscous, Coulomb, offset": (4.0834, 1.61), "asymmetric": (3.1117, 1.22),
}  # fmt: skip


class DriveFriction(Effect):
    """Direction-dependent Coulomb and viscous friction of a screw drive with a constant offset.

    F = r_c F_c sign(v) + r_v F_v v + F_0 with r_c = r_v = 1 for v > 0; sign(v) is smoothed as tanh(v/v_0).
    """

    dry_friction: float = par(20.0, "N", (0.0, 1e4), "Coulomb friction at positive speed F_c")
    viscous_drag: float = par(200.0, "N*s/m", (0.0, 1e5), "viscous friction at positive speed F_v")
    dry_ratio: float = par(1.0, "-", (0.0, 10.0), "Coulomb friction at negative over positive speed r_c")
    viscous_ratio: float = par(1.0, "-", (0.0, 10.0), "viscous friction at negative over positive speed r_v")
    force_offset: float = par(0.0, "N", (-1e3, 1e3), "constant force in negative direction F_0")
    sharpness: float = par(2e-4, "m/s", (1e-6, 1.0), "speed at which Coulomb friction is reached v_0")

    def mover_friction(self, s, z):
        sign = jnp.tanh(s.piston_velocity / self.sharpness)
        negative = 0.5 * (1.0 - sign)
        dry = self.dry_friction * (1.0 + negative * (self.dry_ratio - 1.0))
        viscous = self.viscous_drag * (1.0 + negative * (self.viscous_ratio - 1.0))
        return dry * sign + viscous * s.piston_velocity + self.force_offset


# model: regressors of the inverse dynamics besides the acceleration, unknowns of the closed loop besides the mass
MODELS = {
    "mass alone": ((), ()),
    "viscous, offset": (("v", "1"), ("viscous_drag", "force_offset")),
    "Coulomb, offset": (("s", "1"), ("dry_friction", "force_offset")),
    "viscous, Coulomb, offset": (("v", "s", "1"), ("viscous_drag", "dry_friction", "force_offset")),
    "asymmetric": (
        # an offset would be redundant: Coulomb friction of each direction includes it
        ("v+", "v-", "s+", "s-"),
        ("viscous_drag", "viscous_ratio", "dry_friction", "dry_ratio"),
    ),
}
PRIOR_STD = {"force_offset": 5.0}  # N; on a linear scale, the other parameters have a logarithmic one
PRIOR_LOG_STD = 0.3
CONTROLLER_GAINS = ("cascade_position_gain", "cascade_velocity_gain")
GAIN_STD = 0.02  # relative


def force_error(campaign: Campaign, columns: tuple[str, ...]) -> float:
    """Identify the inverse dynamics by least squares.

    Args:
        campaign: the campaign with the record.
        columns: regressors besides the acceleration, as in `MODELS`.

    Returns:
        The force error 100 ‖F − F_model‖/‖F‖ [%].
    """
    run = campaign.runs[0]
    time, rate = run.time, 1.0 / run.interval
    b, a = butter(4, 2.0 * POSITION_CUTOFF / rate)
    speed = np.gradient(filtfilt(b, a, run.signals["piston_position"]), time)
    sign, ones = np.sign(speed), np.ones_like(speed)
    regressors = {
        "a": np.gradient(speed, time), "v": speed, "s": sign, "1": ones, "v+": np.maximum(speed, 0.0),
        "v-": np.minimum(speed, 0.0), "s+": np.maximum(sign, 0.0), "s-": np.minimum(sign, 0.0),
    }  # fmt: skip
    b, a = butter(4, 2.0 * FORCE_CUTOFF / rate)
    matrix = np.stack([filtfilt(b, a, regressors[n]) for n in ("a", *columns)], axis=1)
    force = filtfilt(b, a, float(get_parameter(campaign.machine, "force_constant")) * run.signals["voltage"])
    residual = force - matrix @ np.linalg.lstsq(matrix, force, rcond=None)[0]
    return 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(force))


def fit_loop(campaign: Campaign, names: tuple[str, ...], gains: tuple[str, ...] = ()) -> Fit:
    """Fit the closed loop: mass, friction parameters `names` and controller gains `gains`."""
    frictionless = DriveFriction(dry_friction=0.0, viscous_drag=0.0)
    friction = structs.replace(frictionless, **{n: getattr(DriveFriction(), n) for n in names})
    machine = structs.replace(campaign.machine, effects=(friction,) if names else ())
    unknowns = list(uncertain_unknowns(campaign, machine))
    for name in names:
        p, _ = find_parameter(machine, name)
        scale = ParameterScale.LINEAR if name in PRIOR_STD else ParameterScale.LOGARITHMIC
        unknowns.append(UnknownParameter(name, p.default, PRIOR_STD.get(name, PRIOR_LOG_STD), p.unit, p.span, scale))
    unknowns += [unknown_around(machine, name, Spread(GAIN_STD)) for name in gains]
    return fit(FitProblem(campaign, machine, tuple(unknowns)), starts=1)


def loop_error(fitted: Fit) -> float:
    """Rms position error [m] of the simulated closed loop from `EVALUATION_START` on."""
    run = fitted.problem.campaign.runs[0]
    error = run.signals["piston_position"] - fitted.outcomes[0].values["piston_position"]
    return float(np.sqrt(np.mean(error[run.time >= EVALUATION_START] ** 2)))


def main(arguments: list[str] | None = None) -> None:
    """Print both errors of every model next to the published ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="campaign of the EMPS data set")
    campaign = read_campaign(parser.parse_args(arguments).folder)
    console = Console(highlight=False, width=150)
    columns = ("model", "force error", "published", "loop, stated gains", "fitted gains", "published", "estimates")
    table = Table(*columns)
    summary = {}
    for name, (columns, unknowns) in MODELS.items():
        with console.status(f"fitting: {name}"):
            fits = [fit_loop(campaign, unknowns, gains) for gains in ((), CONTROLLER_GAINS)]
        force = force_error(campaign, columns)
        stated_gains, fitted_gains = (1e6 * loop_error(fitted) for fitted in fits)
        errors = fits[1].standard_errors
        estimates = ", ".join(f"{n} {v:.4g} ± {errors[n]:.1g}" for n, v in fits[1].values.items())
        published_force, published_loop = PUBLISHED[name]
        table.add_row(
            name, f"{force:.2f} %", f"{published_force:.4g} %", f"{stated_gains:.2f} µm", f"{fitted_gains:.2f} µm",
            f"{published_loop:.3g} µm", estimates,
        )  # fmt: skip
        summary = {
            "force_error": f"{force:.3f}", "loop_um": f"{stated_gains:.3f}",
            "loop_gains_sought_um": f"{fitted_gains:.3f}",
        }  # fmt: skip
    console.print(table)
    print(" ".join(f"{k}={v}" for k, v in summary.items()))
