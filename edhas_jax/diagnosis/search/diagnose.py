"""The diagnosis of a campaign: calibrate its model, search for the sets of effects that it may lack, settle the best.

Runs that are held out decide nothing: the residual on them is the final figure.
"""

import dataclasses
from collections.abc import Iterable
from concurrent.futures import Executor
from typing import NamedTuple

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.candidates.candidate import candidates_for
from edhas_jax.diagnosis.search.checkpoint import Checkpoint
from edhas_jax.diagnosis.search.finished_stage import CALIBRATED, stage_sentence
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.member_laws import with_member_laws
from edhas_jax.diagnosis.search.posterior import SetPosterior
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.set_search import FittedSet, SetSearch
from edhas_jax.diagnosis.search.signatures import signature_table
from edhas_jax.diagnosis.search.weight import Weighing
from edhas_jax.diagnosis.search.workers import Workers, own_classes
from edhas_jax.inference.fit.calibrated_model import Report, calibrate
from edhas_jax.inference.fit.calibration import campaign_residuals
from edhas_jax.inference.fit.confounding import assumed_parameters
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.settled_fit import settled_with_effects, with_tightened_bench, without_wrong_samples
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.noise_measurement import without_refuted_noise
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution


@dataclasses.dataclass(frozen=True)
class _Inputs:
    """What all parts of one diagnosis share: its inputs, its checkpoint, and whom it reports to."""

    campaign: Campaign
    library: tuple[type[Effect], ...] | None
    more: tuple[type[Effect], ...]
    report: Report
    checkpoint: Checkpoint
    workers: Workers | None
    prefix: str = ""  # of the names of what is kept
    known: FittedSet | None = None  # the best set of a search with another noise


class _Found(NamedTuple):
    """The posterior with what weighs its sets, and the time steps per sample."""

    posterior: SetPosterior
    weighing: Weighing
    resolution: TimeResolution


@single_threaded_algebra
def diagnose(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Report | None = None,
    checkpoint: Checkpoint | None = None,
    executor: Executor | None = None,
) -> Diagnosis:
    """Determine whether effects are missing in the model of a campaign, and which.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors. The data are checked
            first, see `checked_campaign`. Where it has no hold-out runs, the last third of each run is held out.
        library: effect classes to consider; all of the library by default. Sensor faults are always considered.
        more: user-defined effect classes to consider in addition.
        on_progress: called with a sentence on the progress.
        checkpoint: keeps finished fits, and has those of an interrupted diagnosis of the same inputs.
        executor: runs independent fits in parallel in its worker processes; by default they are made here one after
            the other.

    Returns:
        The sets of effects with their probabilities, the final model and the verdict.

    Raises:
        FitError: there is nothing to fit, the model cannot be fitted, or the workers were lost.
    """
    report = on_progress or (lambda sentence: None)
    report("checking the data")
    campaign, holdout_sentence = split_for_holdout(checked_campaign(campaign))
    more = tuple(more)
    own = own_classes([*more, campaign.machine, *campaign.machine.replaceable_parts()])
    inputs = _Inputs(
        campaign, None if library is None else tuple(library), more, report, checkpoint or Checkpoint(),
        None if executor is None else Workers(executor, own),
    )  # fmt: skip
    found = _diagnosed(inputs, holdout_sentence)
    quieter = _with_noise_of_fit(campaign, found.after)
    if quieter is campaign:
        return found
    report("once more, with the noise that the fit leaves")
    again = dataclasses.replace(inputs, campaign=quieter, prefix="quieter_", known=found.posterior.best)
    return _diagnosed(again, holdout_sentence)


def _search(inputs: _Inputs) -> _Found:
    campaign, report = inputs.campaign, inputs.report
    calibrated, resolution = inputs.checkpoint.calibration(
        f"{inputs.prefix}calibration", campaign, lambda: calibrate(campaign, report)
    )
    report(stage_sentence(CALIBRATED, calibrated))
    fitted = calibrated.fit.problem
    candidates = candidates_for(campaign, fitted.machine, fitted.instruments, inputs.more, inputs.library)
    table = signature_table(calibrated.fit, candidates, report)
    search = SetSearch(calibrated, table, resolution, report, inputs.checkpoint, inputs.prefix, inputs.workers)
    return _Found(SetPosterior(tuple(map(_without_columns, search.run(inputs.known)))), search.weight, resolution)


def _without_columns(of: FittedSet) -> FittedSet:
    """A set without what only the search needs, which takes much memory."""
    return dataclasses.replace(of, model=None, untried=[], moves=None)


def _diagnosed(inputs: _Inputs, holdout_sentence: str) -> Diagnosis:
    """The diagnosis of a campaign with the noise that it has."""
    report = inputs.report
    posterior, weighing, resolution = _search(inputs)
    settled = posterior.best.evaluated
    if posterior.best.members:
        report("settling the best model")
        settled = settled_with_effects(settled, resolution, report)
    laws, after = with_member_laws(settled, posterior.best.members, resolution, report)
    if posterior.best.members:
        after = without_wrong_samples(with_tightened_bench(after, resolution.coarse), resolution)
    if not any(law.curve for law in laws):
        settled = after
    campaign = after.fit.problem.campaign  # with the start of its records corrected
    before = campaign_residuals(campaign, campaign.machine, Instruments(), resolution.fine)
    report("what the error bars take for granted")
    assumed = tuple(assumed_parameters(after.fit, report))
    return Diagnosis(
        campaign, posterior, weighing, before, settled, after, laws, inputs.checkpoint.seconds, holdout_sentence,
        assumed,
    )  # fmt: skip


def _with_noise_of_fit(campaign: Campaign, final: EvaluatedFit) -> Campaign:
    """The campaign with the noise that the final model leaves, where that is less; see `without_refuted_noise`."""
    fit, bench = final.fit, final.fit.problem.bench
    if fit.problem.campaign.unpredictable:  # which is part of the noise that counts there
        return campaign
    fitted = {run.name: final.residuals[run.name] for run in fit.problem.model().runs}
    return without_refuted_noise(campaign, fitted, len(fit.x) + bench.count + len(fitted) * len(bench.of_runs))
