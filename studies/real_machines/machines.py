"""The machines of the gallery: records, plain model, what is known, the engineer's own effects, what is judged."""

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from edhas_jax.config.recorded_signal import recorded_from_samples
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.mover.asymmetric_damping import AsymmetricDamping
from edhas_jax.machine.effects.mover.lugre_friction import LugreFriction
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Spread, Use
from edhas_jax.measurements.clock_alignment import with_aligned_clocks
from studies.emps.own_rig import campaign_of as emps_campaign
from studies.mbari.discovery import STEPS_PER_SAMPLE as MBARI_STEPS
from studies.mbari.records import campaign_of as mbari_campaign
from studies.mbari.rig import MotorCoulomb, MotorViscous, ReliefValve, SmoothedRecord
from studies.real_machines.crane import Crane, TwoSidedValve
from studies.real_machines.silverbox import CubicSpring, Oscillator
from studies.tanks.discovery import campaign_of as tanks_campaign
from studies.tanks.rig import Overflow

FITTED_SHARE = 0.5, 2.0 / 3.0  # of the one record of the crane (as in the literature) and of the tanks


class RealMachine(NamedTuple):
    """A machine that others have measured.

    Attributes:
        title: what it is.
        record: what was measured, and who published it.
        known: what is known to be missing in the plain model.
        places: the components of the model where it is missing.
        campaign: reads the records in a folder as a campaign with the plain model.
        effects: what an engineer adds once the diagnosis is known, one after the other.
        signal: the measured signal whose error is stated.
        chosen: what was chosen because of these records.
    """

    title: str
    record: str
    known: str
    places: tuple[str, ...]
    campaign: Callable[[Path], Campaign]
    effects: tuple[type[Effect], ...]
    signal: str
    chosen: str


def read_run(file: Path, use: Use, drives: dict[str, str], signals: dict[str, str]) -> BenchRun:
    """A run from a file whose columns are `name [unit]` in SI, or `name`.

    Args:
        file: the file; its first column is the time [s].
        use: what the run is used for.
        drives: the columns of the drives, by drive.
        signals: the columns of the measured signals, by signal.
    """
    table = np.genfromtxt(file, delimiter=",", names=True, deletechars="", replace_space=" ")
    columns = {name.partition(" [")[0]: table[name] for name in table.dtype.names}
    time = table[table.dtype.names[0]]
    recorded = {name: recorded_from_samples(file, time, columns[column]) for name, column in drives.items()}
    measured = {name: columns[column] for name, column in signals.items()}
    return BenchRun(file.stem, file, use, {}, time, measured, np.arange(len(time)) + 2, None, recorded)


def divided(run: BenchRun, share: float) -> tuple[BenchRun, BenchRun]:
    """A record as two runs, both simulated from its start: its first part is fitted, the rest held out."""
    is_first = run.time < run.time[0] + share * (run.time[-1] - run.time[0])

    def part(use: Use, counts: np.ndarray) -> BenchRun:
        signals = {name: np.where(counts, values, np.nan) for name, values in run.signals.items()}
        return dataclasses.replace(run, name=f"{run.name}, {use.value}", use=use, signals=signals)

    return part(Use.FIT, is_first), part(Use.HOLDOUT, ~is_first)


def silverbox_campaign(folder: Path) -> Campaign:
    """4000 samples of a multisine are fitted, 4000 of noise that grows are held out."""
    files = {"multisine.csv": Use.FIT, "arrow.csv": Use.HOLDOUT}
    runs = tuple(read_run(folder / name, use, {"force": "V1"}, {"reading": "V2"}) for name, use in files.items())
    uncertain = {"natural_frequency": 0.05, "damping_ratio": 0.3, "gain": 0.05, "zero": Spread(5e-3, is_absolute=True)}
    return Campaign("silverbox", folder, Oscillator(), uncertain, {"reading": Channel("V", 5e-4)}, runs, ())


def crane_campaign(folder: Path) -> Campaign:
    """The first half of the record is fitted."""
    run = read_run(folder / "arm.csv", Use.FIT, {"opening": "u"}, {"pressure": "p", "travel": "x"})
    uncertain = {"flow_gain": 0.3, "stiffness": 0.3, "acceleration": 0.3, "drag": 0.3, "leak": 1.0}
    channels = {"pressure": Channel("-", 0.03, model_error=0.3), "travel": Channel("-", 0.01, model_error=0.05)}
    return Campaign("crane", folder, Crane(), uncertain, channels, divided(run, FITTED_SHARE[0]), ())


def tanks_divided(folder: Path) -> Campaign:
    """The first two thirds of the record are fitted."""
    campaign = tanks_campaign(folder)
    return dataclasses.replace(campaign, runs=divided(campaign.runs[0], FITTED_SHARE[1]))


def mbari_aligned(folder: Path) -> Campaign:
    """Both records, their clocks aligned."""
    aligned = with_aligned_clocks(mbari_campaign(folder), MBARI_STEPS)
    return dataclasses.replace(aligned, stated_accuracy=dataclasses.replace(aligned.stated_accuracy, clocks={}))


MACHINES = {
    "silverbox": RealMachine(
        title="An oscillator with a spring (Silverbox)",
        record="an electronic circuit, force and position as voltages, 610 Hz; Wigren and Schoukens 2013",
        known="the stiffness grows with the square of the position",
        places=("spring",), campaign=silverbox_campaign, effects=(CubicSpring,), signal="reading",
        chosen="nothing",
    ),
    "crane": RealMachine(
        title="A hydraulic actuator of a crane",
        record="valve opening, oil pressure and travel, scaled; Sjöberg et al. 1995",
        known="nothing is published; the valve of such a crane is proportional, two-sided and saturates",
        places=("valve",), campaign=crane_campaign, effects=(TwoSidedValve,), signal="pressure",
        chosen="the sampling time of 50 ms, which the file does not state; what the model may leave of both signals",
    ),
    "emps": RealMachine(
        title="A linear drive with a ball screw (EMPS)",
        record="position and voltage of a closed loop, 1 kHz; Janot et al. 2019",
        known="Coulomb and viscous friction, different in both directions",
        places=("mover",), campaign=lambda folder: emps_campaign(folder / "run1.csv"),
        effects=(LugreFriction, AsymmetricDamping), signal="voltage",
        chosen="in the library, `asymmetric_damping` and the ranges of `lugre_friction`",
    ),
    "tanks": RealMachine(
        title="Two water tanks in cascade",
        record="pump voltage and level of the lower tank, every 4 s; Schoukens et al. 2016",
        known="both tanks overflow, and a part of the upper one's water falls into the lower one",
        places=("upper_tank", "lower_tank"), campaign=tanks_divided, effects=(Overflow,), signal="level",
        chosen="0.1 V that the model may leave",
    ),
    "mbari": RealMachine(
        title="A hydraulic power take-off of a wave-energy buoy",
        record="ram, oil pressures, motor speed, force, 50 Hz; MBARI, Apache-2.0",
        known="friction of the motor, a relief valve past it, friction of the seals; no leakage can be seen",
        places=("motor", "relief"), campaign=mbari_aligned,
        effects=(MotorViscous, MotorCoulomb, SmoothedRecord, ReliefValve), signal="motor_speed",
        chosen="what the model may leave of each signal; that the record of the ram is smoothed",
    ),
}  # fmt: skip
