"""A real linear drive with friction: the EMPS benchmark, a mass alone and with friction, beside the published figures.

    python -m studies.emps FOLDER

FOLDER holds the campaign of the EMPS data set (A. Janot, M. Gautier, M. Brunot, Data set and reference models of EMPS,
Workshop on Nonlinear System Identification Benchmarks, 2019), which is not part of this project.

Force error: 100 ‖F − F_model‖/‖F‖ of the inverse dynamics, least squares with speed and acceleration of the filtered
position. Closed loop: rms error of the piston in the simulated loop, parameters found by the fit of the same loop, with
the gains of the controller as stated and sought within 2 %: at speed v the piston trails by v/kp, 6 µm for 1 % of kp at
0.1 m/s, and the drive's controller takes its speed from differences of positions, which the continuous loop here does
not. The record starts in motion and the model at rest, so the first 0.1 s are not judged.
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
from edhas_jax.diagnosis.calibration.fit import Fit, FitProblem, fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.parameters import find_parameter, get_parameter
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.unknown_parameters import (
    ParameterScale,
    UnknownParameter,
    relative_unknown,
    uncertain_unknowns,
)

SETTLED = 0.1  # s
POSITION_CUTOFF, FORCE_CUTOFF = 50.0, 20.0  # Hz, zero-phase; the second on both sides of the regression
PUBLISHED = {
    "mass alone": (69.5, 27.5), "viscous, offset": (17.0, 6.66), "Coulomb, offset": (15.1, 6.14),
    "viscous, Coulomb, offset": (4.0834, 1.61), "asymmetric": (3.1117, 1.22),
}  # fmt: skip


class DriveFriction(Effect):
    """Dry and viscous friction of a screw drive, the way back as a factor on the way forth, and a constant offset.

    F = r (F_c sign(v) + F_v v) + F_0, r = 1 forth and r_c, r_v back; sign(v) as tanh(v/v_0)
    """

    dry_friction: float = par(20.0, "N", (0.0, 1e4), "dry friction forth F_c")
    viscous_drag: float = par(200.0, "N*s/m", (0.0, 1e5), "viscous friction forth F_v")
    dry_ratio: float = par(1.0, "-", (0.0, 10.0), "dry friction back over forth r_c")
    viscous_ratio: float = par(1.0, "-", (0.0, 10.0), "viscous friction back over forth r_v")
    force_offset: float = par(0.0, "N", (-1e3, 1e3), "constant force against x, F_0")
    sharpness: float = par(2e-4, "m/s", (1e-6, 1.0), "speed at which dry friction has risen v_0")

    def mover_friction(self, s, z):
        share = jnp.tanh(s.piston_velocity / self.sharpness)
        back = 0.5 * (1.0 - share)
        dry = self.dry_friction * (1.0 + back * (self.dry_ratio - 1.0))
        viscous = self.viscous_drag * (1.0 + back * (self.viscous_ratio - 1.0))
        return dry * share + viscous * s.piston_velocity + self.force_offset


# model: columns of the inverse dynamics beside the acceleration, unknowns of the loop beside the mass
MODELS = {
    "mass alone": ((), ()),
    "viscous, offset": (("v", "1"), ("viscous_drag", "force_offset")),
    "Coulomb, offset": (("s", "1"), ("dry_friction", "force_offset")),
    "viscous, Coulomb, offset": (("v", "s", "1"), ("viscous_drag", "dry_friction", "force_offset")),
    "asymmetric": (
        # an offset would be one number too many: dry friction each way holds it
        ("v+", "v-", "s+", "s-"),
        ("viscous_drag", "viscous_ratio", "dry_friction", "dry_ratio"),
    ),
}
SHIFTS = {"force_offset": 5.0}
GAINS = ("cascade_position_gain", "cascade_velocity_gain")
GAIN_SPREAD = 0.02


def force_error(campaign: Campaign, columns: tuple[str, ...]) -> float:
    """100 ‖F − F_model‖/‖F‖ of the inverse dynamics by least squares."""
    run = campaign.runs[0]
    time, rate = run.time, 1.0 / run.interval
    b, a = butter(4, 2.0 * POSITION_CUTOFF / rate)
    speed = np.gradient(filtfilt(b, a, run.signals["piston_position"]), time)
    sign, ones = np.sign(speed), np.ones_like(speed)
    every = {
        "a": np.gradient(speed, time), "v": speed, "s": sign, "1": ones, "v+": np.maximum(speed, 0.0),
        "v-": np.minimum(speed, 0.0), "s+": np.maximum(sign, 0.0), "s-": np.minimum(sign, 0.0),
    }  # fmt: skip
    b, a = butter(4, 2.0 * FORCE_CUTOFF / rate)
    table = np.stack([filtfilt(b, a, every[n]) for n in ("a", *columns)], axis=1)
    force = filtfilt(b, a, float(get_parameter(campaign.machine, "force_constant")) * run.signals["voltage"])
    left = force - table @ np.linalg.lstsq(table, force, rcond=None)[0]
    return 100.0 * float(np.linalg.norm(left) / np.linalg.norm(force))


def fit_loop(campaign: Campaign, names: tuple[str, ...], gains: tuple[str, ...] = ()) -> Fit:
    """The closed loop fitted with the mass, these parameters of the friction, and these gains of the controller."""
    absent = DriveFriction(dry_friction=0.0, viscous_drag=0.0)
    shown = structs.replace(absent, **{n: getattr(DriveFriction(), n) for n in names})
    machine = structs.replace(campaign.machine, effects=(shown,) if names else ())
    unknowns = list(uncertain_unknowns(campaign, machine))
    for name in names:
        p, _ = find_parameter(machine, name)
        law = ParameterScale.LINEAR if name in SHIFTS else ParameterScale.LOGARITHMIC
        unknowns.append(UnknownParameter(name, p.default, SHIFTS.get(name, 0.3), p.unit, p.span, law))
    unknowns += [relative_unknown(machine, name, GAIN_SPREAD) for name in gains]
    return fit(FitProblem(campaign, machine, tuple(unknowns)), starts=1)


def loop_error(found: Fit) -> float:
    """The rms position error [m] of the simulated loop after the start."""
    run = found.problem.campaign.runs[0]
    off = run.signals["piston_position"] - found.outcomes[0].values["piston_position"]
    return float(np.sqrt(np.mean(off[run.time >= SETTLED] ** 2)))


def main(arguments: list[str] | None = None) -> None:
    """Print both errors of every model beside the published ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="campaign of the EMPS data set")
    campaign = read_campaign(parser.parse_args(arguments).folder)
    console = Console(highlight=False, width=150)
    header = ("model", "force error", "published", "loop, gains as stated", "gains sought", "published", "found")
    table = Table(*header)
    last = {}
    for name, (columns, unknowns) in MODELS.items():
        with console.status(f"fitting: {name}"):
            stated, found = (fit_loop(campaign, unknowns, gains) for gains in ((), GAINS))
        force, (known, loop) = force_error(campaign, columns), (1e6 * loop_error(one) for one in (stated, found))
        told = ", ".join(f"{n} {v:.4g} ± {found.standard_errors[n]:.1g}" for n, v in found.values.items())
        published = PUBLISHED[name]
        table.add_row(
            name, f"{force:.2f} %", f"{published[0]:.4g} %", f"{known:.2f} µm", f"{loop:.2f} µm",
            f"{published[1]:.3g} µm", told,
        )  # fmt: skip
        last = {"force_error": f"{force:.3f}", "loop_um": f"{known:.3f}", "loop_gains_sought_um": f"{loop:.3f}"}
    console.print(table)
    print(" ".join(f"{k}={v}" for k, v in last.items()))
