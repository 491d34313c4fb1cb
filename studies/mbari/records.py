"""The records of the drive as a campaign: units, signs, what was set in a run, and what is uncertain."""

import gzip
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.signal import savgol_filter

from edhas_jax.config.recorded_signal import recorded_from_samples
from edhas_jax.measurements.accuracy import BenchAccuracy, RecorderClock, SensorAccuracy
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from studies.mbari.rig import INCH, PSI, RPM, PowerTakeOff

POUND_FORCE, ATMOSPHERE = 4.448222, 101325.0  # N, Pa
FITTED, HELD_OUT = "2022.01.28T16.46.31.exp.gz", "FrictionIDMovesWithBiasCurr.exp.gz"
MODEL_ERRORS = {  # SI; what a machine of pipes and seals leaves of so few equations
    "motor_speed": 10.0, "lower_pressure": 3e5, "upper_pressure": 3e5, "ram_force": 300.0, "lower_gas": 1e4,
    "upper_gas": 1e4,
}  # fmt: skip
UNITS = {"motor_speed": "rad/s", "ram_force": "N"}  # of the others: Pa
# relative standard deviations; the catalogue's numbers are near, of the others only the order of magnitude is known
UNCERTAIN = {
    "torque_constant": 0.05, "ram_area": 0.02, "displacement": 0.02, "inertia": 1.0, "line_volume": 1.0, "shuttle": 1.0,
    "low.dead_volume": 0.15, "up.dead_volume": 0.15, "low.cooling_time": 1.0, "up.cooling_time": 1.0,
    "low.exponent": 0.03, "up.exponent": 0.03, "low.area": 0.03, "up.area": 0.03, "dead_force": 1.0,
}  # fmt: skip
SMOOTHED_SAMPLES = 21  # of the position, for its second derivative
MOTOR_CLOCK = RecorderClock(("motor_speed", "current"), 0.3)  # s


class Record(NamedTuple):
    """What a file holds, by the name of its column, and the time of the samples [s]."""

    time: np.ndarray
    columns: dict[str, np.ndarray]


def read_record(file: Path) -> Record:
    """Read a record of the bench."""
    with gzip.open(file, "rt") as stream:
        names = stream.readline().lstrip("#").strip().split(",")
        table = np.loadtxt(stream)
    return Record(table[:, 0], {name.partition("(")[0]: table[:, k] for k, name in enumerate(names)})


def run_of(file: Path, use: Use, reversed_signals: tuple[str, ...] = ()) -> BenchRun:
    """A record as a run of a campaign, SI; the filling of the gas springs and the preload are those at its start.

    Args:
        file: the record.
        use: what the run is used for.
        reversed_signals: signals that the recorder has written with the opposite sign.
    """
    time, raw = read_record(file)
    signals = {
        "motor_speed": raw["RPM"] * RPM, "lower_pressure": raw["LowerHydPress"] * PSI,
        "upper_pressure": raw["UpperHydPress"] * PSI, "ram_force": raw["TestMachineForce"] * POUND_FORCE,
        "lower_gas": raw["LowerSpringPressure"] * PSI, "upper_gas": raw["UpperSpringPressure"] * PSI,
    }  # fmt: skip
    signals |= {name: -signals[name] for name in reversed_signals}
    signals |= {name: signals[name] + ATMOSPHERE for name in ("lower_pressure", "upper_pressure")}
    position, machine = raw["Pos"] * INCH, PowerTakeOff()
    # the record of the position has nothing above 2.4 Hz but its rounding, which derivatives would amplify
    acceleration = savgol_filter(position, SMOOTHED_SAMPLES, 4, deriv=2, delta=float(time[1] - time[0]))
    drives = {"ram_position": position, "ram_acceleration": acceleration, "current": raw["WindCurr"]}
    conditions = {
        "lower_start": max(float(signals["lower_pressure"][0]), ATMOSPHERE),
        "low.start_pressure": float(signals["lower_gas"][0]), "up.start_pressure": float(signals["upper_gas"][0]),
        "low.start_travel": float(machine.stroke - position[0]), "up.start_travel": float(position[0]),
    }  # fmt: skip
    recorded = {name: recorded_from_samples(file, time, values) for name, values in drives.items()}
    return BenchRun(file.name.removesuffix(".exp.gz"), file, use, conditions, time, signals, np.arange(len(time)) + 2,
                    None, recorded)  # fmt: skip


def campaign_of(folder: Path, clocks: bool = True, reversed_signals: tuple[str, ...] = ("lower_pressure",)) -> Campaign:
    """The campaign: one record is fitted, the other held out.

    Args:
        folder: holds both records.
        clocks: whether speed and current of the motor may have a clock of their own.
        reversed_signals: signals with the opposite sign in the first record.
    """
    runs = run_of(folder / FITTED, Use.FIT, reversed_signals), run_of(folder / HELD_OUT, Use.HOLDOUT)
    return _campaign(folder, runs, clocks)


def other_records(folder: Path) -> list[Campaign]:
    """A campaign for every further record in the folder, none of which is fitted.

    The lower pressure is taken with the opposite sign where its mean is below zero.
    """
    found = []
    for file in sorted(f for f in folder.glob("*.exp.gz") if f.name not in (FITTED, HELD_OUT)):
        is_reversed = read_record(file).columns["LowerHydPress"].mean() < 0.0
        run = run_of(file, Use.HOLDOUT, ("lower_pressure",) if is_reversed else ())
        found.append(_campaign(folder, (run,), clocks=True))
    return found


def _campaign(folder: Path, runs: tuple[BenchRun, ...], clocks: bool) -> Campaign:
    """The campaign of some runs."""
    channels = {
        name: Channel(UNITS.get(name, "Pa"), 0.02 * error, model_error=error) for name, error in MODEL_ERRORS.items()
    }
    exact = {name: 1e-9 for run in runs for name in run.conditions}
    sensors = {name: SensorAccuracy(gain=3e-3, shift=5e-3) for name in channels}
    recorders = {"motor": MOTOR_CLOCK} if clocks else {}
    accuracy = BenchAccuracy(5e-3, 0.0, exact, sensors, recorders)
    return Campaign("mbari", folder, PowerTakeOff(), UNCERTAIN, channels, runs, (), stated_accuracy=accuracy)

