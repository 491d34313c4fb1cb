"""Discovery of the friction of a linear drive: the model is a mass, one half of the record is fitted, one held out.

    python -m studies.emps.discovery FOLDER

FOLDER holds the campaign of the EMPS data set, see `studies.emps.published_comparison`. Its one record contains two
strokes; it is split where the drive has returned to its first position. The halves start in motion and the model at
rest, so the first 0.1 s of each are not used.

Force error: 100 ‖F − F_model‖/‖F‖ of the simulated closed loop, both low-pass filtered at 20 Hz
(`studies.emps.published_comparison` has that of the inverse dynamics). Finally a force with a period of 2.5 mm in the
position is added, which is known to lower the error of this record and to raise that of another record of the same
machine; the held-out half decides whether it is justified.
`asymmetric_damping` was added to the library, and the plausible ranges of `lugre_friction` widened, because of this
drive: that they are found is no independent test of the library.
The last line of the output: `first=… second=… third=… heldout_two_effects=… heldout_force_error=… periodic=…`; the
force errors on the held-out half with the first two accepted effects, and with all.
"""

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import jax.numpy as jnp
import numpy as np
from rich.console import Console
from rich.table import Table
from scipy.signal import butter, filtfilt

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.report.report import parameter_texts
from edhas_jax.diagnosis.search.diagnose import diagnose
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import signature_table
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.time_resolution import choose_time_resolution
from studies.emps.published_comparison import EVALUATION_START, FORCE_CUTOFF

MIN_GAIN = 12.0  # nats on the held-out half that justify the periodic force
SCREW_PITCH = 2.5e-3  # m


class PeriodicForce(Effect):
    """A force with the period of the ball-screw pitch, F = A sin(2π x/p) + B cos(2π x/p), p = 2.5 mm."""

    sine_force: float = par(0.0, "N", (-1e3, 1e3), "sine amplitude A", plausible=(-3.0, 3.0))
    cosine_force: float = par(0.0, "N", (-1e3, 1e3), "cosine amplitude B", plausible=(-3.0, 3.0))

    def mover_force(self, s, z):
        angle = 2.0 * jnp.pi * s.piston_position / SCREW_PITCH
        return self.sine_force * jnp.sin(angle) + self.cosine_force * jnp.cos(angle)


def split_record(campaign: Campaign) -> Campaign:
    """Split the record where the drive has returned to its first position; the second half is held out."""
    run = campaign.runs[0]
    cut = return_to_start(run.time, run.signals["piston_position"])
    parts = (Use.FIT, slice(None, cut)), (Use.HOLDOUT, slice(cut, None))
    return dataclasses.replace(campaign, runs=tuple(cut_run(run, use, samples) for use, samples in parts))


def return_to_start(time: np.ndarray, position: np.ndarray) -> int:
    """The sample near the middle of a record at which the drive is nearest to its first position."""
    middle = np.flatnonzero(np.abs(time - time.mean()) < 0.1 * time[-1])
    return int(middle[np.argmin(np.abs(position[middle] - position[0]))])


def cut_run(run: BenchRun, use: Use, samples: slice) -> BenchRun:
    """A part of a run as a run of its own; its signals before `EVALUATION_START` are missing (NaN)."""
    time = run.time[samples] - run.time[samples][0]
    signals = {n: np.where(time < EVALUATION_START, np.nan, v[samples]) for n, v in run.signals.items()}
    reference = structs.replace(run.reference, values=run.reference.values[samples])
    return dataclasses.replace(
        run, name=use.value, use=use, time=time, signals=signals, lines=run.lines[samples], reference=reference
    )


def force_errors(evaluated: EvaluatedFit) -> dict[Use, float]:
    """100 ‖F − F_model‖/‖F‖ of the simulated closed loop [%], for each half of the record."""
    campaign, errors = evaluated.fit.problem.campaign, {}
    for run in campaign.runs:
        used = run.time >= EVALUATION_START
        measured = run.signals["voltage"][used]
        residual = evaluated.residuals[run.name]["voltage"][used] * campaign.channels["voltage"].noise
        errors[run.use] = relative_error(residual, measured, run.interval)
    return errors


def relative_error(residual: np.ndarray, measured: np.ndarray, interval: float) -> float:
    """100 ‖F − F_model‖/‖F‖ [%] of samples at an interval [s], both low-pass filtered at 20 Hz."""
    b, a = butter(4, 2.0 * FORCE_CUTOFF * interval)
    residual, measured = (filtfilt(b, a, v) for v in (residual, measured))
    return 100.0 * float(np.linalg.norm(residual) / np.linalg.norm(measured))


def with_periodic_force(diagnosis: Diagnosis, report: Callable[[str], None]) -> EvaluatedFit:
    """The final model of the diagnosis with the periodic force added."""
    after = diagnosis.after
    resolution = choose_time_resolution(after.fit.problem.model(), after.fit.x)
    table = signature_table(after.fit, [Candidate(PeriodicForce)], report, with_free_terms=False)
    search = SetSearch(after, table, resolution, report)
    (move,) = search.additions()
    return search.fit_of(move).evaluated


def main(arguments: list[str] | None = None) -> None:
    """Print the effects that were found one by one with the errors on both halves."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="campaign of the EMPS data set")
    campaign = split_record(read_campaign(parser.parse_args(arguments).folder))
    console = Console(highlight=False, width=150)
    with console.status("") as status:
        diagnosis = diagnose(campaign, on_progress=status.update)
        status.update("with the periodic force")
        periodic_model = with_periodic_force(diagnosis, status.update)
    held_out = "on the held-out half"
    table = Table("model", "residual over noise", held_out, "force error", held_out, "new parameters")
    models = [("mass alone", diagnosis.calibrated, "")]
    growth = diagnosis.growth()
    for of in growth[1:]:
        models.append((str(of), of.evaluated, parameters_text(of.members, of.evaluated)))
    periodic_force = Candidate(PeriodicForce)
    models.append((f"(+ {periodic_force.name})", periodic_model, parameters_text([periodic_force], periodic_model)))
    for name, evaluated, new in models:
        errors = force_errors(evaluated)
        residuals = (f"{evaluated.rms_over_noise(use):.2f}" for use in Use)
        table.add_row(name, *residuals, *(f"{errors[use]:.2f} %" for use in Use), new)
    console.print(table)
    gain = periodic_model.log_evidence - diagnosis.after.log_evidence
    fall = diagnosis.after.holdout_half_chi_square().sum() - periodic_model.holdout_half_chi_square().sum()
    periodic = "justified" if fall > MIN_GAIN else "refused"
    print(f"periodic force: the log evidence rises by {gain:.1f}, "
          f"chi-square/2 of the held-out half falls by {fall:.1f}: {periodic}")  # fmt: skip
    names = [candidate.id for candidate in diagnosis.named] + ["none"] * 3
    with_two = growth[min(2, len(growth) - 1)].evaluated
    print(f"first={names[0]} second={names[1]} third={names[2]} "
          f"heldout_two_effects={force_errors(with_two)[Use.HOLDOUT]:.3f} "
          f"heldout_force_error={force_errors(diagnosis.after)[Use.HOLDOUT]:.3f} periodic={periodic}")  # fmt: skip


def parameters_text(candidates: Sequence[Candidate], evaluated: EvaluatedFit) -> str:
    """The fitted parameters of some candidates, as text."""
    return ", ".join(text for candidate in candidates for text in parameter_texts(candidate, evaluated.fit))


if __name__ == "__main__":
    main()
