"""A real linear drive, its model a mass alone: what is missing, found on one half of the record, judged on the other.

    python -m studies.emps.discovery FOLDER

FOLDER holds the campaign of the EMPS data set, see `studies.emps.published_comparison`. Its one record goes to and fro
twice; it is cut where the drive is back at its beginning, the first half is fitted and the second never. The halves
begin in motion and the model at rest, so that the first 0.1 s of each are not used.

Force error: 100 ‖F − F_model‖/‖F‖ of the simulated closed loop, both below 20 Hz (`studies.emps.published_comparison`
has that of the inverse dynamics). At the end a force with a period of 2.5 mm in the position is put in, which is known
to lower the error of this record and to raise that of another one of the same machine: does the half that was not used
want it?
The last line: `first=… second=… heldout_force_error=… periodic=…`
"""

import argparse
import dataclasses
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, filtfilt

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.report.report import parameter_texts
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import is_confirmed
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.forward_selection import diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.trial import Trial, try_candidate
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.time_resolution import choose_time_resolution
from studies.emps.published_comparison import FORCE_CUTOFF, SETTLED

STEPS = 12


class PeriodicForce(Effect):
    """A force with the pitch of the ball screw, F = A sin(2π x/p) + B cos(2π x/p), p = 2.5 mm."""

    sine_force: float = par(0.0, "N", (-1e3, 1e3), "sine amplitude A", plausible=(-3.0, 3.0))
    cosine_force: float = par(0.0, "N", (-1e3, 1e3), "cosine amplitude B", plausible=(-3.0, 3.0))

    def mover_force(self, s, z):
        angle = 2.0 * jnp.pi * s.piston_position / 2.5e-3
        return self.sine_force * jnp.sin(angle) + self.cosine_force * jnp.cos(angle)


def halved(campaign: Campaign) -> Campaign:
    """The campaign with the two halves of its record, the second held out."""
    run = campaign.runs[0]
    position = run.signals["piston_position"]
    middle = np.flatnonzero(np.abs(run.time - run.time.mean()) < 0.1 * run.time[-1])
    cut = int(middle[np.argmin(np.abs(position[middle] - position[0]))])
    parts = (Use.FIT, slice(None, cut)), (Use.HOLDOUT, slice(cut, None))
    return dataclasses.replace(campaign, runs=tuple(part(run, use, at) for use, at in parts))


def part(run: BenchRun, use: Use, at: slice) -> BenchRun:
    """A part of a run as a run of its own, without its first samples."""
    time = run.time[at] - run.time[at][0]
    signals = {n: np.where(time < SETTLED, np.nan, v[at]) for n, v in run.signals.items()}
    reference = structs.replace(run.reference, values=run.reference.values[at])
    return dataclasses.replace(
        run, name=use.value, use=use, time=time, signals=signals, lines=run.lines[at], reference=reference
    )


def force_errors(judged: EvaluatedFit) -> dict[Use, float]:
    """100 ‖F − F_model‖/‖F‖ of the simulated closed loop, by half of the record."""
    campaign, out = judged.fit.problem.campaign, {}
    for run in campaign.runs:
        seen = run.time >= SETTLED
        measured = run.signals["voltage"][seen]
        left = judged.residuals[run.name]["voltage"][seen] * campaign.channels["voltage"].noise
        b, a = butter(4, 2.0 * FORCE_CUTOFF * run.interval)
        left, measured = (filtfilt(b, a, v) for v in (left, measured))
        out[run.use] = 100.0 * float(np.linalg.norm(left) / np.linalg.norm(measured))
    return out


def with_period(found: Diagnosis) -> Trial:
    """The model that the diagnosis ends with, with the periodic force fitted besides."""
    after, accepted = found.after, [t.candidate for t in found.accepted]
    score = ScoreTest(after.fit, accepted).score(Candidate(PeriodicForce))
    resolution = choose_time_resolution(after.fit.problem.model(), after.fit.x)
    return try_candidate(after, accepted, score, resolution, STEPS, finish=after.near_noise, progressive=False)


def main(arguments: list[str] | None = None) -> None:
    """Print what is found, step by step, with the errors on both halves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="campaign of the EMPS data set")
    campaign = halved(read_campaign(parser.parse_args(arguments).folder))
    console = Console(highlight=False, width=150)
    with console.status("") as status:
        found = diagnose(campaign, on_progress=status.update)
        status.update("with the periodic force")
        trial = with_period(found)
    table = Table("model", "residual over noise", "on the other half", "force error", "on the other half", "new")
    models = [("mass alone", found.calibrated, "")]
    for one, after in zip(found.accepted, found.rounds[1:], strict=True):
        models.append((f"+ {one.candidate.name}", after.baseline, sizes(one)))
    models.append((f"(+ {trial.candidate.name})", trial.evaluated, sizes(trial)))
    for name, judged, new in models:
        errors = force_errors(judged)
        table.add_row(
            name, *(f"{judged.rms_over_noise(use):.2f}" for use in Use), *(f"{errors[use]:.2f} %" for use in Use), new
        )  # fmt: skip
    console.print(table)
    periodic = "justified" if is_confirmed(found.after, trial) else "refused"
    print(f"the periodic force raises the evidence by {trial.log_evidence_gain:.1f}; "
          "on the other half half of chi-square falls by "
          f"{trial.holdout_half_chi_square_fall:.1f}: {periodic}")  # fmt: skip
    names = [t.candidate.name for t in found.accepted] + ["none"] * 2
    print(f"first={names[0]} second={names[1]} heldout_force_error={force_errors(found.after)[Use.HOLDOUT]:.3f} "
          f"periodic={periodic}")  # fmt: skip


def sizes(trial: Trial) -> str:
    """The fitted parameters of a candidate."""
    return ", ".join(parameter_texts(trial.candidate, trial.evaluated.fit))


if __name__ == "__main__":
    main()
