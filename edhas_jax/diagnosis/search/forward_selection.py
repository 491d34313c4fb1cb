"""Forward selection of missing effects: calibrate, then add the candidates that held-out runs confirm, one by one.

Each round adds one candidate to the model. Candidates are ranked by their predicted fall of χ² (chi-square scale),
compared by their log-evidence gain after a refit, and accepted if ½χ² of the held-out runs falls significantly too.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any

from edhas_jax.diagnosis.calibration.confounding import assumed_parameters
from edhas_jax.diagnosis.calibration.fit import FitError, FitProblem
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.diagnosis.search.candidates import Candidate, build_problem, candidates_for
from edhas_jax.diagnosis.search.checkpoint import Checkpoint
from edhas_jax.diagnosis.search.decision_rules import decide_verdict, replaces_accepted
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, refine_fit, start_coordinates
from edhas_jax.diagnosis.search.generic_terms import GENERIC_TERMS
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.localisation import localise_discrepancy
from edhas_jax.diagnosis.search.result import Diagnosis, Round, Verdict, accepted_trials
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.selection_round import generic_candidates, search_round
from edhas_jax.diagnosis.search.stage_encoding import RoundEnd, StageDecoder, StageEncoder, accepted_candidates
from edhas_jax.diagnosis.search.trial import TRIAL_STEPS, Trial, try_candidate
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution

MAX_EFFECTS = 3
CALIBRATION_STEPS, FINAL_STEPS = 25, 12  # maximum number of Levenberg-Marquardt steps
LOCAL_MINIMUM_GAIN_SHARE = 0.1  # of a candidate's gain: a refit without it that gains more was in a local minimum

Report = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class _Search:
    """What all stages of one diagnosis share: its inputs, its checkpoint, and whom it reports to."""

    campaign: Campaign
    library: tuple[type[Effect], ...] | None
    more: tuple[type[Effect], ...]
    checkpoint: Checkpoint
    report: Report

    def stage(self, name: str, compute: Callable, encode: Callable, decode: Callable) -> Any:
        """The value of a stage from the checkpoint, or computed."""
        return self.checkpoint.stage(name, self.campaign, self.more, compute, encode, decode)

    def candidates(self, fitted: FitProblem) -> list[Candidate]:
        """The candidates that a model lacks."""
        found = candidates_for(self.campaign, fitted.machine, fitted.instruments, self.more)
        if self.library is None:
            return found
        allowed = {kind.id for kind in (*self.library, *self.more)}
        return [c for c in found if c.signal is not None or c.id in allowed]


def diagnose(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Report | None = None,
    checkpoint: Checkpoint | None = None,
) -> Diagnosis:
    """Determine whether effects are missing in the model of a campaign, and which.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors. The data are checked
            first, see `checked_campaign`.
        library: effect classes to consider; all of the library by default. Sensor faults are always considered.
        more: user-defined effect classes to consider in addition.
        on_progress: called with a sentence on the progress.
        checkpoint: keeps the finished stages, and has those of an interrupted diagnosis of the same inputs.

    Where the campaign has no hold-out runs, the last third of each run is held out.

    Returns:
        The verdict with all scores, trials, probabilities and the final model.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    report, checkpoint = on_progress or (lambda sentence: None), checkpoint or Checkpoint()
    report("checking the data")
    campaign = checked_campaign(campaign)
    library = None if library is None else tuple(library)
    campaign, holdout_sentence = split_for_holdout(campaign)
    search = _Search(campaign, library, tuple(more), checkpoint, report)
    calibrated, resolution = search.stage(
        "calibration", lambda: calibrate(campaign, report), StageEncoder.start, StageDecoder.start
    )
    rounds = _select_forward(search, calibrated, resolution)
    shares: dict[str, float] = {}
    if decide_verdict(rounds) is Verdict.UNKNOWN_EFFECT:
        shares, trials = search.stage(
            "localisation", lambda: _localise(rounds, resolution, report),
            StageEncoder.localisation, StageDecoder.localisation,
        )  # fmt: skip
        replacement = trials[0] if trials and replaces_accepted(rounds, trials[0]) else None
        if replacement is not None and replacement.candidate.kind in GENERIC_TERMS:
            generic = tuple(t for t in trials if t.candidate.kind in GENERIC_TERMS)
            rounds = [dataclasses.replace(rounds[0], accepted=None, generic_trials=generic)]
        elif replacement is not None:
            first = dataclasses.replace(
                rounds[0], trials=(*rounds[0].trials, replacement), accepted=replacement, generic_trials=()
            )
            rounds = _select_forward(search, rounds[0].baseline, resolution, first)
    before = campaign_residuals(campaign, campaign.machine, Instruments(), resolution.fine)
    calibrated, after, verdict = rounds[0].baseline, rounds[-1].baseline, decide_verdict(rounds)
    shares = shares if verdict is Verdict.UNKNOWN_EFFECT else {}
    report("what the error bars take for granted")
    assumed = tuple(assumed_parameters(after.fit, report))
    seconds = checkpoint.seconds
    return Diagnosis(
        campaign, verdict, tuple(rounds), before, calibrated, after, seconds, shares, holdout_sentence, assumed
    )


def calibrate(campaign: Campaign, on_progress: Report | None = None) -> tuple[EvaluatedFit, TimeResolution]:
    """Fit the uncertain parameters before any effect is added: the fit from which the search begins.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors.
        on_progress: called with a sentence on the progress.

    Returns:
        The fit, at the fine step where its residual is near the noise, and the time steps per sample.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    report = on_progress or (lambda sentence: None)
    calibrated, resolution = _calibrate(campaign, report)
    return _refine_near_noise(calibrated, resolution, report), resolution


def _calibrate(campaign: Campaign, report: Report) -> tuple[EvaluatedFit, TimeResolution]:
    """Fit the uncertain parameters at the coarse step; return the fit and the time steps."""
    problem = build_problem(campaign, campaign.machine, Instruments(), ())
    centre = start_coordinates(problem, {})
    report("choosing the time step")
    resolution = choose_time_resolution(problem.model(), centre)
    report("fitting the uncertain parameters")
    try:
        return fit_coarse(problem, centre, resolution.coarse, CALIBRATION_STEPS), resolution
    except FitError:  # derivatives need a finer step than signals where valves bounce
        resolution = TimeResolution(resolution.fine, resolution.fine, resolution.error)
        return fit_coarse(problem, centre, resolution.coarse, CALIBRATION_STEPS), resolution


def _select_forward(
    search: _Search, calibrated: EvaluatedFit, resolution: TimeResolution, first: Round | None = None
) -> list[Round]:
    """Add one candidate after another until held-out runs confirm none.

    Args:
        search: the diagnosis.
        calibrated: the model before any candidate.
        resolution: coarse and fine time steps per sample.
        first: result of the first round, if it is known.
    """
    baseline, rounds = calibrated, []
    name = "round" if first is None else "replacing_round"
    while True:
        mounted = accepted_candidates(rounds)
        end = search.stage(
            f"{name}_{len(rounds) + 1}",
            lambda: _finish_round(search, baseline, rounds, resolution, first),  # noqa: B023 called at once
            StageEncoder.round_end,
            lambda decoder, plain: decoder.round_end(plain, mounted),  # noqa: B023
        )
        rounds.append(end.round)
        if end.baseline is None:
            return rounds
        search.report(f"found: {end.round.accepted.candidate.name}")
        baseline, resolution, first = end.baseline, end.resolution, None


def _finish_round(
    search: _Search, baseline: EvaluatedFit, rounds: Sequence[Round], resolution: TimeResolution, first: Round | None
) -> RoundEnd:
    """One round, repeated once where the model without the accepted candidate was in a local minimum."""
    candidates, last = search.candidates(baseline.fit.problem), len(rounds) == MAX_EFFECTS
    accepted = accepted_candidates(rounds)

    def search_once() -> tuple[Round, TimeResolution]:
        return search_round(baseline, accepted, candidates, resolution, search.report, last)

    new_round, new_resolution = search_once() if first is None else (first, resolution)
    found = new_round.accepted
    better = None if found is None else _refit_without(baseline, found, resolution, search.report)
    if better is not None:
        search.report(
            f"the model without {found.candidate.name} fits better when started from the fit with it; "
            "repeating the round"
        )
        baseline = better
        new_round, new_resolution = search_once()
        found = new_round.accepted
    if found is None:
        return RoundEnd(new_round, None, new_resolution)
    is_refined = baseline.near_noise and new_resolution.fine == resolution.fine
    refined = found.evaluated if is_refined else _refine_near_noise(found.evaluated, new_resolution, search.report)
    return RoundEnd(new_round, refined, new_resolution)


def _refit_without(
    baseline: EvaluatedFit, found: Trial, resolution: TimeResolution, report: Report
) -> EvaluatedFit | None:
    """Refit the model without a candidate, started from the fit with it; None where the log-evidence gains little.

    A calibration in a local minimum can be led out of it by any candidate, which then seems to explain the misfit.
    """
    problem = baseline.fit.problem
    start = start_coordinates(problem, found.evaluated.fit.values)
    try:
        refitted = fit_coarse(problem, start, resolution.coarse, CALIBRATION_STEPS)
    except FitError:
        return None
    refitted = _refine_near_noise(refitted, resolution, report)
    gain = refitted.log_evidence - baseline.log_evidence
    return refitted if gain > LOCAL_MINIMUM_GAIN_SHARE * found.log_evidence_gain else None


def _localise(
    rounds: Sequence[Round], resolution: TimeResolution, report: Report
) -> tuple[dict[str, float], list[Trial]]:
    """The share of χ² that each component accounts for, and the trials made for it, the largest gain first."""
    report("localising the discrepancy")
    first, calibrated = rounds[0], rounds[0].baseline

    def attempt(score: Score) -> Trial:
        report(f"{score.candidate.location}: trying {score.candidate.name}")
        return try_candidate(calibrated, (), score, resolution, TRIAL_STEPS, calibrated.near_noise)

    candidates = [score.candidate for score in first.scores] + generic_candidates(calibrated.fit.problem.machine)
    first_trials = [*first.trials, *first.generic_trials]
    shares, trials = localise_discrepancy(calibrated, candidates, first_trials, accepted_trials(rounds), attempt)
    return shares, sorted((*trials, *first.generic_trials), key=lambda t: -t.log_evidence_gain)


def _refine_near_noise(evaluated: EvaluatedFit, resolution: TimeResolution, report: Report) -> EvaluatedFit:
    """Refine a fit at the fine step where its residual is so near the noise that the solver's error matters."""
    if not evaluated.near_noise:
        return evaluated
    report("refining the fit")
    return refine_fit(evaluated, resolution, FINAL_STEPS)


def add_effect(
    campaign: Campaign, kind: type[Effect], on_progress: Report | None = None
) -> tuple[EvaluatedFit, EvaluatedFit]:
    """Fit the model of a campaign without and with one given effect.

    Args:
        campaign: the measurements.
        kind: class of the effect.
        on_progress: called with a sentence on the progress.

    Returns:
        The fit without and the fit with the effect, all uncertain parameters being fitted in both.

    Raises:
        FitError: there is nothing to fit, the model cannot be fitted, or the machine cannot have the effect.
    """
    report = on_progress or (lambda sentence: None)
    possible = {c.id: c for c in candidates_for(campaign, campaign.machine, Instruments(), (kind,)) if c.signal is None}
    if kind.id not in possible:
        raise FitError(f"{kind.id} cannot be added to {campaign.name}: its machine has it already, or no slot for it")
    baseline, resolution = _calibrate(campaign, report)
    report(f"fitting with {kind.id}")
    score = ScoreTest(baseline.fit, ()).score(possible[kind.id])
    trial = try_candidate(baseline, (), score, resolution, TRIAL_STEPS, finish=True)
    if trial.evaluated is None:
        raise FitError(f"the model with {kind.id} fails (it is not finite) wherever the fit has looked")
    return baseline, trial.evaluated
