"""What does the plain model of a real electro-hydraulic drive lack, and how much better does it predict with it?

    python -m studies.mbari FOLDER [--diagnose] [--out FOLDER]

FOLDER holds `2022.01.28T16.46.31.exp.gz`, which is fitted, and `FrictionIDMovesWithBiasCurr.exp.gz`, which is held out:
it decides nothing but the shift of its own clock. On further records of the same kind in FOLDER the accepted model is
simulated at the end. The motion of the ram and the current of the windings are imposed;
speed of the motor, oil pressures, force of the test machine and pressures of the gas springs are simulated.

Steps: what the check of the data says; the clocks of the two recorders; the model with its numbers fitted; then one
effect after another, each time the one with the largest predicted fall of χ². An effect is accepted where the
log-evidence rises by more than a hundredth of the excess of ½χ² that is left, because what is left is no white noise,
and none of its numbers ends at the limit of its prior. The others are listed with what they are worth.

With `--diagnose`, `edhas diagnose` is asked first, which knows none of these effects, and finds curves.

Errors are rms over the whole record: of the motor's speed; of the pressure difference times the displacement, which is
the error of the motor's torque balance; of the force on the ram.

Source of the records: MBARI, test bench of the power take-off of a wave-energy buoy, licence Apache-2.0.
"""

import argparse
import dataclasses
from pathlib import Path
from typing import NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.config.writer import dump_config
from edhas_jax.diagnosis.candidates.candidate import Candidate, candidates_for
from edhas_jax.diagnosis.report.conclusions import conclusions
from edhas_jax.diagnosis.search.chosen_effects import ChosenModel, calibrated_model, with_effect
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import signature_table
from edhas_jax.inference.fit.fit_problem import CALIBRATION_BOUND
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.clock_alignment import with_aligned_clocks
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.time_resolution import TimeResolution
from studies.mbari.records import campaign_of, other_records
from studies.mbari.rig import (
    MotorCoulomb,
    MotorLeakage,
    MotorViscous,
    PowerTakeOff,
    ReliefValve,
    SealCoulomb,
    SealViscous,
    SmoothedRecord,
)

EFFECTS = (ReliefValve, MotorCoulomb, MotorViscous, SealCoulomb, SealViscous, SmoothedRecord, MotorLeakage)
STEPS_PER_SAMPLE = 8
MIN_SHARE = 0.01  # gain over what is left, from which an effect is accepted
SEARCH = TimeResolution(8, 8, float("nan"))
MAX_STEPS = 80
AT_BOUND = CALIBRATION_BOUND - 0.05  # prior standard deviations from which an estimate counts as at its bound


class Errors(NamedTuple):
    """Rms errors over a record: speed of the motor [rad/s], its torque balance [N·m], force on the ram [N]."""

    speed: float
    torque: float
    force: float


class Rung(NamedTuple):
    """One model: its name, its errors on the fitted and the held-out record, and the gain of its last effect [nats]."""

    name: str
    fitted: Errors
    held_out: Errors
    gain: float = float("nan")
    left: float = float("nan")
    text: str = ""


def errors_of(machine: PowerTakeOff, campaign: Campaign) -> list[Errors]:
    """The errors of a machine on every run of a campaign, simulated freely, all samples counted."""
    plain = dataclasses.replace(campaign, machine=machine)
    found = MeasurementModel(plain, machine, (), plain.runs).predict_all_runs(np.zeros(0), STEPS_PER_SAMPLE)
    rows = []
    for k, run in enumerate(plain.runs):
        left = {name: found[k].values[name] - measured for name, measured in run.signals.items()}
        torque = float(machine.displacement) * _rms(left["lower_pressure"] - left["upper_pressure"])
        rows.append(Errors(_rms(left["motor_speed"]), torque, _rms(left["ram_force"])))
    return rows


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def next_effect(campaign: Campaign, before: ChosenModel, kinds: list[type[Effect]]) -> type[Effect]:
    """The effect with the largest predicted fall of the misfit."""
    fit = before.evaluated.fit
    candidates = [c for c in candidates_for(campaign, fit.problem.machine, Instruments(), kinds) if c.kind in kinds]
    table = signature_table(fit, candidates, _silent, with_free_terms=False)
    moves = SetSearch(before.evaluated, table, before.resolution, _silent).additions()
    return max(moves, key=lambda move: move.fall).added.kind


def _silent(sentence: str) -> None:
    """Report nothing."""


def effect_text(model: ChosenModel, candidate: Candidate) -> str:
    """The fitted numbers of an effect with their standard errors."""
    fit = model.evaluated.fit
    own, values, errors = candidate.own_unknowns(fit.problem.unknowns), fit.values, fit.standard_errors
    return ", ".join(f"{n} {values[u.name]:.3g} ± {errors[u.name]:.1g} {u.unit}" for n, u in own.items())


def fitted_machine(model: ChosenModel) -> PowerTakeOff:
    """The machine of a fit with its values."""
    return edhas.change(model.evaluated.fit.problem.machine, **model.evaluated.fit.values)


def main() -> None:
    """Print what the check says, the ladder, and the headline figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--out", type=Path, default=Path("runs/mbari"))
    parser.add_argument("--diagnose", action="store_true", help="first what edhas diagnose says without any effect")
    options = parser.parse_args()
    console = Console(highlight=False, width=150)

    for remark in checked_campaign(campaign_of(options.folder, clocks=False, reversed_signals=())).remarks:
        if "opposite sign" in remark.sentence:
            console.print(f"{remark.file.name}: {remark.sentence}")
    as_recorded = campaign_of(options.folder, clocks=False)
    aligned = with_aligned_clocks(campaign_of(options.folder), STEPS_PER_SAMPLE)
    for remark in aligned.remarks:
        console.print(f"{remark.file.name}: {remark.sentence}")
    accuracy = dataclasses.replace(aligned.stated_accuracy, clocks={})
    campaign = checked_campaign(dataclasses.replace(aligned, stated_accuracy=accuracy))
    if options.diagnose:
        found = edhas.diagnose(campaign, library=())
        places = ", ".join(f"{place} {p:.2f}" for place, p in found.posterior.locations().items())
        console.print("\n".join([*conclusions(found)[:4], f"where: {places}"]))
    rungs = [Rung("plain, clocks as recorded", *errors_of(as_recorded.machine, as_recorded)),
             Rung("plain, clocks aligned", *errors_of(aligned.machine, aligned))]  # fmt: skip

    calibrated = model = dataclasses.replace(calibrated_model(campaign), resolution=SEARCH)
    rungs.append(Rung("its numbers fitted", *errors_of(fitted_machine(model), aligned), left=model.evaluated.excess))
    kinds, refused, named = list(EFFECTS), [], []
    while kinds:
        kind = next_effect(campaign, model, kinds)
        kinds.remove(kind)
        console.print(f"fitting with {kind.id}", style="dim")
        trial = with_effect(campaign, model, kind, max_steps=MAX_STEPS)
        candidate, left = trial.effects[-1], trial.evaluated.excess
        gain = trial.evaluated.log_evidence - model.evaluated.log_evidence
        text = effect_text(trial, candidate)
        rung = Rung(f"+ {kind.id}", *errors_of(fitted_machine(trial), aligned), gain, left, text)
        coordinates = candidate.own_coordinates(trial.evaluated.fit).values()
        if gain > MIN_SHARE * left and all(abs(x) < AT_BOUND for x in coordinates):
            model = trial
            named.append(kind.id)
            rungs.append(rung)
        else:
            refused.append(rung)
    without = calibrated
    for candidate in (c for c in model.effects if c.kind is not SmoothedRecord):
        without = with_effect(campaign, without, candidate.kind, max_steps=MAX_STEPS)
    rest = Rung("these, but the record as it is", *errors_of(fitted_machine(without), aligned))
    rungs.append(rest._replace(left=without.evaluated.excess))
    print_ladder(console, "accepted", rungs)
    print_ladder(console, "refused, each with the model at its time", refused)
    for other in other_records(options.folder):
        other = with_aligned_clocks(other, STEPS_PER_SAMPLE)
        (errors,) = errors_of(fitted_machine(model), other)
        sentences = "; ".join(remark.sentence for remark in other.remarks)
        console.print(f"{other.runs[0].name}, not used before: {errors.speed:.1f} rad/s, {errors.torque:.3f} N m, "
                      f"{errors.force:.0f} N; {sentences}")  # fmt: skip
    values = model.evaluated.fit.values
    console.print(", ".join(f"{name} {value:.4g}" for name, value in values.items()))
    options.out.mkdir(parents=True, exist_ok=True)
    (options.out / "model.yaml").write_text(dump_config(fitted_machine(model)), encoding="utf-8")
    leakage = [rung.gain for rung in refused if rung.name == "+ motor_leakage"]
    last = rungs[-2]
    print(
        f"first={named[0] if named else 'none'} named={','.join(named)} fitted_rad_s={last.fitted.speed:.2f} "
        f"heldout_rad_s={last.held_out.speed:.2f} fitted_n_m={last.fitted.torque:.3f} "
        f"heldout_n_m={last.held_out.torque:.3f} fitted_n={last.fitted.force:.0f} heldout_n={last.held_out.force:.0f} "
        f"heldout_unsmoothed_rad_s={rest.held_out.speed:.2f} "
        f"leakage_gain={leakage[0] if leakage else float('nan'):.0f} leakage={'refused' if leakage else 'accepted'}"
    )


def print_ladder(console: Console, title: str, rungs: list[Rung]) -> None:
    """Print models with their errors on the fitted and on the held-out record."""
    columns = "model", "speed, rad/s", "torque balance, N m", "force, N", "log-evidence", "left", "numbers"
    table = Table(*columns, title=title)
    for rung in rungs:
        rows = zip(rung.fitted, rung.held_out, (".1f", ".3f", ".0f"), strict=True)
        errors = [f"{fitted:{form}} / {held_out:{form}}" for fitted, held_out, form in rows]
        gain, left = ("" if np.isnan(value) else f"{value:.0f}" for value in (rung.gain, rung.left))
        table.add_row(rung.name, *errors, gain, left, rung.text)
    console.print(table)
