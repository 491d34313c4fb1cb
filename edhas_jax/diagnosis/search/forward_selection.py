"""The search for what is missing: calibrate, screen every suspect, try the best, accept what new runs confirm."""

import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from edhas_jax.diagnosis.calibration.fit import FitError
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.diagnosis.search.candidates import Suspect, can_have, held_by_belief, problem_of, suspects_for
from edhas_jax.diagnosis.search.evaluated_fit import Judged, refined, search, start_from
from edhas_jax.diagnosis.search.generic_terms import FORMS
from edhas_jax.diagnosis.search.localisation import ask_parts
from edhas_jax.diagnosis.search.result import Diagnosis, Round, Verdict, accepted_in
from edhas_jax.diagnosis.search.screening import Score, Screen
from edhas_jax.diagnosis.search.trial import Trial, again, try_suspect
from edhas_jax.diagnosis.search.trials import PROMISE, TRIAL_STEPS, best_reached, second_look, tournament
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution, choose_time_resolution

MOST_EFFECTS = 3
CALIBRATION_STEPS, FINAL_STEPS = 25, 12
GAIN = 12.0  # rise of the evidence for which an effect is accepted, if new runs agree
SIGMAS = 2.0  # standard errors by which ½χ² of new runs must fall
CLEAR, FEWER = 40.0, 1.0  # rise of the evidence beyond which fewer will do: new runs may be short and show little
MARGIN = 30.0  # rise of the evidence by which a bare formula must beat a named effect
AHEAD = 2.0  # how much more a formula must promise than an effect has brought, to be worth a trial
MOST = 0.9  # share of what a model leaves over beyond noise for which an effect accounts fully
PIT = 0.1  # share of an effect's gain from which on the fit without it must have been stuck
FLOOR = 1.02  # residual over noise on new runs above which something is left to explain


def diagnose(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Say whether anything is missing in a campaign's model, and what.

    `library` restricts the effects that are suspected, `more` adds a user's own. `on_progress` gets a sentence now and
    then.

    Raises:
        FitError: nothing to fit, or a model that cannot be fitted.
    """
    began, say = time.perf_counter(), on_progress or (lambda sentence: None)
    null, resolution = _calibrated(campaign, say)
    null = _finished(null, resolution, say)
    allowed = None if library is None else {kind.id for kind in (*library, *more)}
    rounds = _rounds(campaign, null, resolution, more, allowed, say)
    parts: dict[str, float] = {}
    if _verdict(rounds) is Verdict.UNKNOWN_EFFECT:
        parts, tried = _asked(rounds, resolution, say)
        alone = tried[0] if tried and _stands_alone(rounds, tried[0]) else None
        if alone is not None and alone.suspect.kind in FORMS:
            forms = tuple(t for t in tried if t.suspect.kind in FORMS)
            rounds = [dataclasses.replace(rounds[0], accepted=None, forms=forms)]
        elif alone is not None:
            begun = dataclasses.replace(rounds[0], trials=(*rounds[0].trials, alone), accepted=alone, forms=())
            rounds = _rounds(campaign, rounds[0].before, resolution, more, allowed, say, begun)
    as_it_was = campaign_residuals(campaign, campaign.machine, Instruments(), resolution.fine)
    seconds = time.perf_counter() - began
    null, after, verdict = rounds[0].before, rounds[-1].before, _verdict(rounds)
    parts = parts if verdict is Verdict.UNKNOWN_EFFECT else {}
    return Diagnosis(campaign, verdict, tuple(rounds), as_it_was, null, after, seconds, parts)


def _calibrated(campaign: Campaign, say) -> tuple[Judged, TimeResolution]:
    """The campaign's model with what is uncertain fitted at a rough step, and the steps that serve."""
    problem = problem_of(campaign, campaign.machine, Instruments(), ())
    centre = start_from(problem, {})
    say("looking for the step that serves")
    resolution = choose_time_resolution(problem.model(), centre)
    say("fitting what is uncertain")
    try:
        return search(problem, centre, resolution.coarse, CALIBRATION_STEPS), resolution
    except FitError:  # derivatives ask for a finer step than signals do where valves bounce
        resolution = TimeResolution(resolution.fine, resolution.fine, resolution.error)
        return search(problem, centre, resolution.coarse, CALIBRATION_STEPS), resolution


def _rounds(
    campaign: Campaign, null: Judged, resolution: TimeResolution, more, allowed: set[str] | None, say,
    begun: Round | None = None,
) -> list[Round]:  # fmt: skip
    """One effect after another, until nothing that is left to suspect is confirmed by new runs.

    `begun` is what the first search has led to, if it is known.
    """
    before, rounds, looked = null, [], False
    while True:
        accepted = [r.accepted.suspect for r in rounds]
        fitted = before.fit.problem
        suspects = suspects_for(campaign, fitted.machine, fitted.instruments, more)
        if allowed is not None:
            suspects = [s for s in suspects if s.signal is not None or s.id in allowed]
        last = len(rounds) == MOST_EFFECTS
        one_more, finer = (begun, resolution) if begun else _round(before, accepted, suspects, resolution, say, last)
        begun, found = None, one_more.accepted
        better = None if found is None or looked else _without(before, found, resolution, say)
        if better is not None:
            say(f"the model without {found.suspect.name} does better from where the fit with it has led: once more")
            before, looked = better, True
            continue
        rounds.append(one_more)
        if found is None:
            return rounds
        looked = False
        say(f"found: {found.suspect.name}")
        done = before.near_noise and finer.fine == resolution.fine
        before, resolution = found.judged if done else _finished(found.judged, finer, say), finer


def _without(before: Judged, found: Trial, resolution: TimeResolution, say) -> Judged | None:
    """The model without an effect, fitted from where the fit with it has led; None where that is no better.

    A fit that has ended in a pit may be led out of it by any effect, which then seems to explain what was not missing.
    """
    problem = before.fit.problem
    try:
        there = search(problem, start_from(problem, found.judged.fit.values), resolution.coarse, CALIBRATION_STEPS)
    except FitError:
        return None
    there = _finished(there, resolution, say)
    return there if there.evidence - before.evidence > PIT * found.gain else None


def _round(
    before: Judged,
    accepted: Sequence[Suspect],
    suspects: Sequence[Suspect],
    resolution: TimeResolution,
    say,
    last: bool,
) -> tuple[Round, TimeResolution]:
    """The search for one more effect, and the steps that serve after it.

    Formulas are asked where no effect promises to account for what is left over.
    """
    screen, excess = Screen(before.fit, accepted), _excess(before)
    scores = _screened(screen, suspects, say)
    if last:
        return Round(before, tuple(scores), (), None), resolution
    most = scores[0].fall if scores else 0.0
    forms: list[Score] = []
    if excess > PROMISE and most < 0.5 * excess:
        forms = _screened(screen, _formulas(before.fit.problem.machine), say)
    first = bool(forms) and forms[0].fall > AHEAD * most
    tried = tournament(before, accepted, forms, resolution, say) if first else []
    reached = best_reached(tried, forms)
    trials = tournament(before, accepted, scores, resolution, say, reached)
    trials, resolution = _looked_closer(before, trials, resolution, say)
    best = max(trials, key=lambda t: t.gain, default=None)
    found = best if best is not None and confirmed(before, best) else None
    gain = found.gain if found else 0.0
    if forms and not first and 2.0 * gain < MOST * excess:
        promising = [s for s in forms if s.fall > AHEAD * gain]
        tried = tournament(before, accepted, promising, resolution, say, gain)
    tried = sorted(tried, key=lambda t: -t.gain)
    if tried and confirmed(before, tried[0]) and tried[0].gain > MARGIN + gain:
        # a bare formula does better than any effect: what is missing is not in the library
        return Round(before, tuple(scores), tuple(trials), None, tuple(tried)), resolution
    return Round(before, tuple(scores), tuple(trials), found), resolution


def _formulas(machine: Rig) -> list[Suspect]:
    """The bare formulas that have a place in a machine."""
    return [Suspect(kind) for kind in FORMS if can_have(machine, kind)]


def _asked(rounds: Sequence[Round], resolution: TimeResolution, say) -> tuple[dict[str, float], list[Trial]]:
    """What each part of the machine accounts for, and what was fitted to find out, the best first."""
    say("asking each part of the machine what it could account for")
    first, null = rounds[0], rounds[0].before

    def attempt(score: Score) -> Trial:
        say(f"{score.suspect.where}: trying {score.suspect.name}")
        return try_suspect(null, (), score, resolution, TRIAL_STEPS, null.near_noise)

    suspects = [score.suspect for score in first.scores] + _formulas(null.fit.problem.machine)
    parts, tried = ask_parts(null, suspects, [*first.trials, *first.forms], accepted_in(rounds), attempt)
    return parts, sorted((*tried, *first.forms), key=lambda t: -t.gain)


def _stands_alone(rounds: Sequence[Round], trial: Trial) -> bool:
    """Whether one law explains clearly more than all that was accepted, which then only stood in for it."""
    reached = sum(t.gain for t in accepted_in(rounds))
    return confirmed(rounds[0].before, trial) and trial.gain > MARGIN + reached


def _excess(judged: Judged) -> float:
    """How far χ² of the fitted runs lies above what noise alone gives, beyond the scatter of that."""
    samples = sum(np.isfinite(v).sum() for signals in judged.fit.residuals.values() for v in signals.values())
    return 2.0 * judged.cost - float(samples) - 3.0 * math.sqrt(2.0 * float(samples))


def _screened(screen: Screen, suspects: Sequence[Suspect], say) -> list[Score]:
    """The scores of all suspects, the most promising first."""
    scores = []
    for k, suspect in enumerate(suspects):
        say(f"screening {k + 1} of {len(suspects)}: {suspect.name}")
        scores.append(screen.score(suspect))
    return sorted(scores, key=lambda score: -score.fall)


def _looked_closer(
    before: Judged, trials: list[Trial], resolution: TimeResolution, say
) -> tuple[list[Trial], TimeResolution]:
    """The trials, the best fitted again where it is confirmed and yet leaves much over; and the steps that serve then.

    What is left may be the step's doing, as the effect may ask for a finer one, or that of a pit on the way down.
    """
    best = max(trials, key=lambda t: t.gain, default=None)
    if best is None or not confirmed(before, best):
        return trials, resolution
    closer, finer = best, _serving(best, resolution)
    if not best.judged.near_noise and finer.coarse > resolution.coarse:
        say(f"a finer step for {best.suspect.name}")
        fitted = best.judged.fit
        closer = again(before, best, search(fitted.problem, fitted.x, finer.coarse, TRIAL_STEPS))
    if not closer.judged.near_noise:
        say(f"{best.suspect.name}: first without the runs that fit worst")
        closer = second_look(before, closer, finer.coarse, CALIBRATION_STEPS)
        finer = _serving(closer, finer)
    return [closer if t is best else t for t in trials], finer


def _serving(trial: Trial, resolution: TimeResolution) -> TimeResolution:
    """The steps that serve where a trial has led too."""
    here = choose_time_resolution(trial.judged.fit.problem.model(), trial.judged.fit.x)
    return TimeResolution(max(resolution.coarse, here.coarse), max(resolution.fine, here.fine), here.error)


def _finished(judged: Judged, resolution: TimeResolution, say) -> Judged:
    """A fit with the solver's error taken out, where what is left over is so little that this would matter."""
    if not judged.near_noise:
        return judged
    say("refining the fit")
    return refined(judged, resolution, FINAL_STEPS)


def confirmed(before: Judged, trial: Trial) -> bool:
    """Whether the evidence for a suspect is clear, and runs that no fit has seen say so too."""
    if trial.judged is None or trial.gain < GAIN:
        return False
    gains = before.half_chi_square() - trial.judged.half_chi_square()
    # under the better model the fall of ½χ² has a variance of twice itself
    sigmas = FEWER if trial.gain > CLEAR else SIGMAS
    return float(gains.sum()) > sigmas * math.sqrt(2.0 * max(float(np.abs(gains).sum()), 1.0))


def _unexplained(judged: Judged) -> bool:
    """Whether more is left over than noise on runs that no fit has seen."""
    campaign = judged.fit.problem.campaign
    use = Use.HOLDOUT if campaign.runs_for(Use.HOLDOUT) else Use.FIT
    samples = sum(int(np.isfinite(v).sum()) for v in judged.rows(campaign.runs_for(use)))
    # the rms of few samples scatters by 1/√(2n)
    return judged.level(use) > max(FLOOR, 1.0 + 3.0 / math.sqrt(2.0 * max(samples, 1)))


def _verdict(rounds: Sequence[Round]) -> Verdict:
    after = rounds[-1].before
    stand_in = any(held_by_belief(t.suspect, after.fit) for t in accepted_in(rounds))
    if rounds[-1].forms or stand_in or _unexplained(after):
        return Verdict.UNKNOWN_EFFECT
    if rounds[0].accepted is None:
        return Verdict.ADEQUATE
    return Verdict.AMBIGUOUS if any(len(r.group()) > 1 for r in rounds) else Verdict.MISSING_EFFECT


def add_effect(
    campaign: Campaign, kind: type[Effect], on_progress: Callable[[str], None] | None = None
) -> tuple[Judged, Judged]:
    """The model of a campaign without and with one more effect, everything uncertain fitted in both.

    Raises:
        FitError: nothing to fit, a model that cannot be fitted, or an effect that the machine cannot have.
    """
    say = on_progress or (lambda sentence: None)
    able = {s.id: s for s in suspects_for(campaign, campaign.machine, Instruments(), (kind,)) if s.signal is None}
    if kind.id not in able:
        raise FitError(f"{kind.id} cannot be added to {campaign.name}: its machine has it already, or no place for it")
    before, resolution = _calibrated(campaign, say)
    say(f"fitting with {kind.id}")
    score = Screen(before.fit, ()).score(able[kind.id])
    trial = try_suspect(before, (), score, resolution, TRIAL_STEPS, finish=True)
    if trial.judged is None:
        raise FitError(f"the model with {kind.id} fails (it is not finite) wherever the fit has looked")
    return before, trial.judged
