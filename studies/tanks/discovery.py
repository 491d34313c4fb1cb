"""Is the overflow of two water tanks found from a record of one level, and by how much does it reduce the error?

    python -m studies.tanks FOLDER [--out FOLDER]

FOLDER holds `estimation.csv` with the columns `time [s]`, `pump_voltage [V]`, `level_voltage [V]`, and may hold
`validation.csv` of the same shape, which judges: the models are simulated on it with what they have learnt, from the
same start. Steps: the model as written down; its numbers calibrated; the diagnosis, which knows no overflow, and what
it says; the model with the curves that it offers; the model with `Overflow` of `rig.py`, written from that curve.

Errors are rms of the level in volts, simulated freely over the whole record.

Source of the record: Schoukens, Mattsson, Wigren, Noel, "Cascaded tanks benchmark combining soft and hard
nonlinearities", 2016.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

import edhas_jax as edhas
from edhas_jax.config.recorded_signal import resample_uniformly
from edhas_jax.config.writer import dump_config
from edhas_jax.core.structs import parameters
from edhas_jax.diagnosis.chosen_effects import fit_with_effects
from edhas_jax.diagnosis.search.conclusions import conclusions
from edhas_jax.diagnosis.search.curve_candidate import CurveCandidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.tanks.rig import Overflow, TwoTanks

MODEL_ERROR = 0.1  # V; five equations do not follow a plant of pipes any better
NOISE = 0.02  # V, of the level sensor, before it is measured
SENSOR_END = 10.0  # V
# the tanks are alike; of everything else only the order of magnitude is known
UNCERTAIN = {
    "outlet": 0.4, "outlet_ratio": 0.05, "pump_gain": 0.4, "sensor_zero": 1.0, "upper_start": 0.4, "lower_start": 0.3,
}  # fmt: skip


class Stage(NamedTuple):
    """A model: its name, and its rms error on the estimation and on the validation record (NaN without one) [V]."""

    name: str
    error: float
    judged: float


def read_run(file: Path, use: Use) -> BenchRun:
    """A record as a run of a campaign."""
    time, voltage, level = np.genfromtxt(file, delimiter=",", skip_header=1).T
    drives = {"pump_voltage": resample_uniformly(file, time, voltage)}
    lines = np.arange(len(time)) + 2
    return BenchRun(file.stem, file, use, {}, time, {"level": level}, lines, None, drives)


def campaign_of(folder: Path) -> Campaign:
    """The campaign of the estimation record."""
    run = read_run(folder / "estimation.csv", Use.FIT)
    # levels are counted in volts of the sensor, which therefore has neither gain nor offset errors
    exact = SensorAccuracy(gain=1e-9, offset=1e-9, shift=1e-9)
    accuracy = BenchAccuracy(trigger=1e-3, recorder_filter=0.0, signals={"level": exact})
    channel = Channel("V", NOISE, model_error=MODEL_ERROR, limits=(-np.inf, SENSOR_END))
    machine = TwoTanks(**run.drives)
    return Campaign("tanks", folder, machine, UNCERTAIN, {"level": channel}, (run,), (), stated_accuracy=accuracy)


def error_of(machine: TwoTanks, campaign: Campaign, run: BenchRun) -> float:
    """Rms difference [V] of the level and that of a machine, simulated freely over a whole run."""
    one = dataclasses.replace(campaign, runs=(run,), machine=machine)
    predicted = MeasurementModel(one, machine, (), (run,)).predict_all_runs(np.zeros(0), 4)[0].values["level"]
    return float(np.sqrt(np.nanmean(np.square(predicted - run.signals["level"]))))


def fitted_machine(fit: EvaluatedFit) -> TwoTanks:
    """The machine of a fit with its values."""
    return edhas.change(fit.fit.machine, **fit.fit.values)


def main() -> None:
    """Print the stages, what the diagnosis says, and the headline figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/tanks"))
    options = parser.parse_args()
    campaign = campaign_of(options.folder)
    run, judge = campaign.runs[0], options.folder / "validation.csv"
    other = read_run(judge, Use.HOLDOUT) if judge.is_file() else None
    stages: list[Stage] = []

    def note(name: str, machine: TwoTanks) -> None:
        judged = float("nan") if other is None else error_of(machine, campaign, other)
        stages.append(Stage(name, error_of(machine, campaign, run), judged))

    note("as written down", campaign.machine)
    found = edhas.diagnose(campaign)
    print("\n".join(conclusions(found)))
    calibrated, with_overflow = fit_with_effects(campaign, [Overflow])
    note("calibrated", fitted_machine(calibrated.evaluated))
    for trial in found.free_trials:
        print(f"tried: {trial.candidate.text}, explains {trial.explained_share:.0%} of the misfit of the fitted part")
        if isinstance(trial.candidate, CurveCandidate) and trial.evaluated is not None:
            note(f"with {trial.candidate.text}", fitted_machine(trial.evaluated))
    note("with Overflow", fitted_machine(with_overflow.evaluated))
    for stage in stages:
        print(f"{stage.name:55s} {stage.error:6.3f} V   judged {stage.judged:6.3f} V")
    values = with_overflow.evaluated.fit.values
    print(", ".join(f"{p.name} {values[f'overflow.{p.name}']:.3g} {p.unit}" for p in parameters(Overflow)))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "model.yaml").write_text(dump_config(fitted_machine(with_overflow.evaluated)), encoding="utf-8")
    place = next(iter(found.location_probabilities()), "none")
    print(
        f"before_v={stages[0].error:.3f} calibrated_v={stages[1].error:.3f} overflow_v={stages[-1].error:.3f} "
        f"judged_v={stages[-1].judged:.3f} place={place}"
    )
