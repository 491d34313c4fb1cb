"""Forward selection of missing effects: calibrate, then add the candidates that held-out runs confirm, one by one.

Each round adds one candidate to the model. Candidates are ranked by their predicted fall of χ² (chi-square scale),
compared by their log-evidence gain after a refit, and accepted if ½χ² of the held-out runs falls significantly too.
"""

import dataclasses
import time
from collections.abc import Callable, Iterable, Sequence

from edhas_jax.diagnosis.calibration.fit import FitError
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.diagnosis.search.candidates import build_problem, candidates_for
from edhas_jax.diagnosis.search.decision_rules import decide_verdict, replaces_accepted
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit, fit_coarse, refine_fit, start_coordinates
from edhas_jax.diagnosis.search.generic_terms import GENERIC_TERMS
from edhas_jax.diagnosis.search.localisation import localise_discrepancy
from edhas_jax.diagnosis.search.result import Diagnosis, Round, Verdict, accepted_trials
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.diagnosis.search.selection_round import generic_candidates, search_round
from edhas_jax.diagnosis.search.trial import TRIAL_STEPS, Trial, try_candidate
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution

MAX_EFFECTS = 3
CALIBRATION_STEPS, FINAL_STEPS = 25, 12  # maximum number of Levenberg-Marquardt steps
LOCAL_MINIMUM_GAIN_SHARE = 0.1  # of a candidate's gain: a refit without it that gains more was in a local minimum

Report = Callable[[str], None]


def diagnose(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Report | None = None,
) -> Diagnosis:
    """Determine whether effects are missing in the model of a campaign, and which.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors.
        library: effect classes to consider; all of the library by default. Sensor faults are always considered.
        more: user-defined effect classes to consider in addition.
        on_progress: called with a sentence on the progress.

    Returns:
        The verdict with all scores, trials, probabilities and the final model.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    began, report = time.perf_counter(), on_progress or (lambda sentence: None)
    calibrated, resolution = _calibrate(campaign, report)
    calibrated = _refine_near_noise(calibrated, resolution, report)
    allowed = None if library is None else {kind.id for kind in (*library, *more)}
    rounds = _select_forward(campaign, calibrated, resolution, more, allowed, report)
    shares: dict[str, float] = {}
    if decide_verdict(rounds) is Verdict.UNKNOWN_EFFECT:
        shares, trials = _localise(rounds, resolution, report)
        replacement = trials[0] if trials and replaces_accepted(rounds, trials[0]) else None
        if replacement is not None and replacement.candidate.kind in GENERIC_TERMS:
            generic = tuple(t for t in trials if t.candidate.kind in GENERIC_TERMS)
            rounds = [dataclasses.replace(rounds[0], accepted=None, generic_trials=generic)]
        elif replacement is not None:
            first = dataclasses.replace(
                rounds[0], trials=(*rounds[0].trials, replacement), accepted=replacement, generic_trials=()
            )
            rounds = _select_forward(campaign, rounds[0].baseline, resolution, more, allowed, report, first)
    before = campaign_residuals(campaign, campaign.machine, Instruments(), resolution.fine)
    seconds = time.perf_counter() - began
    calibrated, after, verdict = rounds[0].baseline, rounds[-1].baseline, decide_verdict(rounds)
    shares = shares if verdict is Verdict.UNKNOWN_EFFECT else {}
    return Diagnosis(campaign, verdict, tuple(rounds), before, calibrated, after, seconds, shares)


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
    campaign: Campaign, calibrated: EvaluatedFit, resolution: TimeResolution, more: Iterable[type[Effect]],
    allowed: set[str] | None, report: Report, first: Round | None = None,
) -> list[Round]:  # fmt: skip
    """Add one candidate after another until held-out runs confirm none.

    Args:
        campaign: the measurements.
        calibrated: the model before any candidate.
        resolution: coarse and fine time steps per sample.
        more: user-defined effect classes.
        allowed: ids of the effects to consider; None for all.
        report: called with a sentence on the progress.
        first: result of the first round, if it is known.
    """
    baseline, rounds, rechecked = calibrated, [], False
    while True:
        accepted = [r.accepted.candidate for r in rounds]
        fitted = baseline.fit.problem
        candidates = candidates_for(campaign, fitted.machine, fitted.instruments, more)
        if allowed is not None:
            candidates = [c for c in candidates if c.signal is not None or c.id in allowed]
        last = len(rounds) == MAX_EFFECTS
        if first is None:
            new_round, new_resolution = search_round(baseline, accepted, candidates, resolution, report, last)
        else:
            new_round, new_resolution = first, resolution
        first, found = None, new_round.accepted
        better = None if found is None or rechecked else _refit_without(baseline, found, resolution, report)
        if better is not None:
            report(
                f"the model without {found.candidate.name} fits better when started from the fit with it; "
                "repeating the round"
            )
            baseline, rechecked = better, True
            continue
        rounds.append(new_round)
        if found is None:
            return rounds
        rechecked = False
        report(f"found: {found.candidate.name}")
        is_refined = baseline.near_noise and new_resolution.fine == resolution.fine
        baseline = found.evaluated if is_refined else _refine_near_noise(found.evaluated, new_resolution, report)
        resolution = new_resolution


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
