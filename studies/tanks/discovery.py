"""Is the overflow of two water tanks found from a record of one level, and by how much does it reduce the error?

    python -m studies.tanks FOLDER [--out FOLDER]

FOLDER holds `estimation.csv` with the columns `time [s]`, `pump_voltage [V]`, `level_voltage [V]`, and may hold
`validation.csv` of the same shape, which judges: the models are simulated on it with what they have learnt, from the
same start. Steps: the model as written down; its numbers calibrated; the diagnosis, which knows no overflow, and what
it says; the model with the curves that it offers; the model with `Overflow` of `rig.py`, written from such a curve;
with other laws of the outlets.

Errors are rms of the level in volts, simulated freely over the whole record. "Quarters": the last three quarters of the
record, each predicted by a fit to all the rest; the first quarter contains the start and is always fitted. The model
with laws that predicts them best is kept, and judged. Curves are fitted to the first two thirds; their error on the
last third follows.

Source of the record: Schoukens, Mattsson, Wigren, Noel, "Cascaded tanks benchmark combining soft and hard
nonlinearities", 2016.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np

import edhas_jax as edhas
from edhas_jax.config.recorded_signal import recorded_from_samples
from edhas_jax.config.writer import dump_config
from edhas_jax.diagnosis.candidates.candidate import Candidate, with_candidates
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.report.conclusions import conclusions
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit import fit as calibration
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.accuracy import BenchAccuracy, SensorAccuracy
from edhas_jax.measurements.campaign import BenchRun, Campaign, Channel, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.tanks.rig import LowerOutlet, Overflow, TwoTanks, UpperOutlet

MODEL_ERROR = 0.1  # V; five equations do not follow a plant of pipes any better
NOISE = 0.02  # V, of the level sensor, before it is measured
SENSOR_END = 10.0  # V
STARTS, MAX_STEPS, QUARTERS = 16, 200, 4
LAWS = (Overflow, LowerOutlet, UpperOutlet)
# the tanks are alike; of everything else only the order of magnitude is known
UNCERTAIN = {
    "outlet": 0.4, "outlet_ratio": 0.05, "pump_gain": 0.4, "sensor_zero": 2.0, "upper_start": 0.6, "lower_start": 0.5,
}  # fmt: skip


class Stage(NamedTuple):
    """A model and its rms errors [V], NaN where there is none.

    Attributes:
        name: of the model.
        error: on the estimation record.
        unseen: on parts of it that were not fitted.
        judged: on the validation record.
    """

    name: str
    error: float
    unseen: float
    judged: float


def read_run(file: Path, use: Use) -> BenchRun:
    """A record as a run of a campaign."""
    time, voltage, level = np.genfromtxt(file, delimiter=",", skip_header=1).T
    drives = {"pump_voltage": recorded_from_samples(file, time, voltage)}
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


def errors_of(machine: TwoTanks, campaign: Campaign, run: BenchRun) -> np.ndarray:
    """Level of a machine, simulated freely over a whole run, less the measured one (samples,) [V]."""
    one = dataclasses.replace(campaign, runs=(run,), machine=machine)
    predicted = MeasurementModel(one, machine, (), (run,)).predict_all_runs(np.zeros(0), 4)[0].values["level"]
    return predicted - run.signals["level"]


def rms(values: np.ndarray) -> float:
    """Root mean square of the values that are finite."""
    return float(np.sqrt(np.nanmean(np.square(values))))


def fitted_machine(fit: Fit) -> TwoTanks:
    """The machine of a fit with its values."""
    return edhas.change(fit.problem.machine, **fit.values)


def best_fit(campaign: Campaign, kinds: tuple[type[Effect], ...]) -> Fit:
    """A fit with some effects, from many starts: overflows have many local minima."""
    problem = with_candidates(calibration_problem(campaign), map(Candidate, kinds))
    return calibration(problem, starts=STARTS, max_steps=MAX_STEPS)


def error_of_quarters(campaign: Campaign, kinds: tuple[type[Effect], ...]) -> float:
    """Rms error [V] of the last three quarters of the record, each predicted by a fit to all the rest."""
    (run,), parts = campaign.runs, []
    for part in np.array_split(np.arange(len(run.time)), QUARTERS)[1:]:
        level = np.array(run.signals["level"])
        level[part] = np.nan
        without = dataclasses.replace(campaign, runs=(dataclasses.replace(run, signals={"level": level}),))
        parts.append(errors_of(fitted_machine(best_fit(without, kinds)), campaign, run)[part])
    return rms(np.concatenate(parts))


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

    def note(name: str, machine: TwoTanks, unseen: float = float("nan")) -> None:
        judged = float("nan") if other is None else rms(errors_of(machine, campaign, other))
        stages.append(Stage(name, rms(errors_of(machine, campaign, run)), unseen, judged))

    note("as written down", campaign.machine)
    found = edhas.diagnose(campaign)
    print("\n".join(conclusions(found)))
    checked = checked_campaign(campaign)
    note("calibrated", fitted_machine(best_fit(checked, ())), error_of_quarters(checked, ()))
    fitted_samples = len(split_for_holdout(checked).campaign.runs[0].time)
    for of in found.posterior.sets:
        if len(of.members) == 1 and isinstance(of.members[0], CurveCandidate):
            machine = fitted_machine(of.evaluated.fit)
            note(f"with {of}", machine, rms(errors_of(machine, campaign, run)[fitted_samples:]))
    fits = []
    for count in range(1, len(LAWS) + 1):
        kinds = LAWS[:count]
        fit = best_fit(checked, kinds)
        note(f"with {' and '.join(kind.__name__ for kind in kinds)}", fitted_machine(fit),
             error_of_quarters(checked, kinds))  # fmt: skip
        fits.append(fit)
        own = [u for u in fit.problem.unknowns if "." in u.name]
        print(", ".join(f"{u.name} {fit.values[u.name]:.3g} {u.unit}" for u in own))
    for stage in stages:
        print(f"{stage.name:52s} {stage.error:6.3f} V   unseen {stage.unseen:6.3f} V   judged {stage.judged:6.3f} V")
    options.out.mkdir(parents=True, exist_ok=True)
    laws = stages[-len(LAWS) :]
    best = min(range(len(LAWS)), key=lambda k: laws[k].unseen)
    (options.out / "model.yaml").write_text(dump_config(fitted_machine(fits[best])), encoding="utf-8")
    place = next(iter(found.posterior.locations()), "none")
    print(
        f"before_v={stages[0].error:.3f} calibrated_v={stages[1].error:.3f} overflow_v={laws[0].error:.3f} "
        f"overflow_quarters_v={laws[0].unseen:.3f} best_v={laws[best].error:.3f} "
        f"best_quarters_v={laws[best].unseen:.3f} judged_v={laws[best].judged:.3f} place={place}"
    )
