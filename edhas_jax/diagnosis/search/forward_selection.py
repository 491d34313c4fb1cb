"""The search for missing effects: calibrate, add candidates one by one, then take back what is not needed.

Each round adds one candidate to the model. Candidates are ranked by their predicted fall of χ² (chi-square scale) and
compared by their log-evidence gain after a refit, relative to what is left unexplained. A backward pass removes each
member of the set again. Runs that are held out decide nothing: the residual on them is the final figure.
"""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from typing import Any

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.calibration.confounding import assumed_parameters
from edhas_jax.diagnosis.calibration.fit_problem import FitProblem
from edhas_jax.diagnosis.calibration.result import campaign_residuals
from edhas_jax.diagnosis.search.backward_pass import TakenBack, gains_with_own_law, take_back
from edhas_jax.diagnosis.search.calibrated_model import calibrate, misfit
from edhas_jax.diagnosis.search.candidates import Candidate, candidates_for
from edhas_jax.diagnosis.search.checkpoint import Checkpoint
from edhas_jax.diagnosis.search.decision_rules import (
    CLEARLY_LESS,
    LAW_ERROR_SHARE,
    MIN_GAIN,
    is_promising,
    remaining,
    scatter_of_fits,
)
from edhas_jax.diagnosis.search.effect_of_curve import round_with_effect_of_curve
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.finished_stage import CALIBRATED, FOUND, stage_sentence
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.law_deviation import LawDeviation, law_deviation_columns
from edhas_jax.diagnosis.search.member_rivals import with_rivals_compared
from edhas_jax.diagnosis.search.result import Diagnosis, MemberTest, Round, mounted_candidates
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.selection_round import end_of_round, search_round
from edhas_jax.diagnosis.search.stage_encoding import RoundEnd, StageDecoder, StageEncoder
from edhas_jax.diagnosis.search.unknown_cause import localise
from edhas_jax.diagnosis.workers import Workers, own_classes
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.noise_measurement import without_refuted_noise
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.time_resolution import TimeResolution

MAX_EFFECTS = 3
UNEXPLAINED_SHARE = 0.2  # of the misfit of the calibrated model: if effects leave more, its place is sought
# a second search begins with a candidate that gains more than a share of the gain of the best, where the first search
# leaves more than a share of the misfit; its result is taken if it leaves clearly less than that of the first one
RUNNER_UP_SHARE, MISFIT_SHARE = 0.5, 0.1
BETTER_SHARE = 0.2  # of the misfit of the calibrated model; a refit that reduces it by more restarts the search
CURVES_TRIED = 2  # largest number of trials with which a round may end: the best one, then the next one
MIN_CURVE_STRENGTH = 3.0  # gain of a free curve over what it leaves, from which it may be the law of an effect

Report = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class _Search:
    """What all stages of one diagnosis share: its inputs, its checkpoint, and whom it reports to."""

    campaign: Campaign
    library: tuple[type[Effect], ...] | None
    more: tuple[type[Effect], ...]
    checkpoint: Checkpoint
    report: Report
    workers: Workers | None
    prefix: str = ""  # of the names of the stages

    def stage(self, name: str, compute: Callable, encode: Callable, decode: Callable) -> Any:
        """The value of a stage from the checkpoint, or computed."""
        return self.checkpoint.stage(f"{self.prefix}{name}", self.campaign, self.more, compute, encode, decode)

    def round(self, name: str, mounted: Sequence[Candidate], compute: Callable[[], RoundEnd]) -> RoundEnd:
        """A round after those that mounted some candidates, from the checkpoint, or computed."""
        return self.stage(name, compute, StageEncoder.round_end, lambda of, plain: of.round_end(plain, mounted))

    def candidates(self, fitted: FitProblem) -> list[Candidate]:
        """The candidates that a model lacks."""
        return candidates_for(self.campaign, fitted.machine, fitted.instruments, self.more, self.library)


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
            first, see `checked_campaign`.
        library: effect classes to consider; all of the library by default. Sensor faults are always considered.
        more: user-defined effect classes to consider in addition.
        on_progress: called with a sentence on the progress.
        checkpoint: keeps the finished stages, and has those of an interrupted diagnosis of the same inputs.
        executor: runs independent fits in parallel in its worker processes; by default they are made here one after
            the other, where a trial that stays far behind is given up early.

    Where the campaign has no hold-out runs, the last third of each run is held out.

    Returns:
        The verdict with all scores, trials, probabilities and the final model.

    Raises:
        FitError: there is nothing to fit, the model cannot be fitted, or the workers were lost.
    """
    report, checkpoint = on_progress or (lambda sentence: None), checkpoint or Checkpoint()
    report("checking the data")
    campaign = checked_campaign(campaign)
    library = None if library is None else tuple(library)
    campaign, holdout_sentence = split_for_holdout(campaign)
    more = tuple(more)
    own = own_classes([*more, campaign.machine, *campaign.machine.replaceable_parts()])
    workers = None if executor is None else Workers(executor, own)
    search = _Search(campaign, library, more, checkpoint, report, workers)
    found = _search_once(search, holdout_sentence)
    quieter = _with_noise_of_fit(campaign, found.after)
    if quieter is campaign:
        return found
    report("once more, with the noise that the fit leaves")
    return _search_once(dataclasses.replace(search, campaign=quieter, prefix="quieter_"), holdout_sentence)


def _with_noise_of_fit(campaign: Campaign, final: EvaluatedFit) -> Campaign:
    """The campaign with the noise that the final model leaves, where that is less; see `without_refuted_noise`."""
    fit, bench = final.fit, final.fit.problem.bench
    if fit.problem.campaign.unpredictable:  # which is part of the noise that counts there
        return campaign
    fitted = {run.name: final.residuals[run.name] for run in fit.problem.model().runs}
    return without_refuted_noise(campaign, fitted, len(fit.x) + bench.count + len(fitted) * len(bench.of_runs))


def _search_once(search: _Search, holdout_sentence: str) -> Diagnosis:
    """The diagnosis of a campaign with the noise that it has."""
    campaign, more, report, workers = search.campaign, search.more, search.report, search.workers
    calibrated, resolution = search.stage(
        "calibration", lambda: calibrate(campaign, report), StageEncoder.start, StageDecoder.start
    )
    report(stage_sentence(CALIBRATED, calibrated))
    test = ScoreTest(calibrated.fit, ())
    forward = _select_forward(search, calibrated, resolution, test)
    kept = _take_back_and_go_on(search, forward, resolution, test, "round")
    if _is_much_better(kept.rounds[0].baseline, calibrated):
        report("once more, from a better fit of the uncertain parameters")
        calibrated = kept.rounds[0].baseline
        report(stage_sentence(CALIBRATED, calibrated))
        test = ScoreTest(calibrated.fit, ())
        forward = _select_forward(search, calibrated, resolution, test, name="restarted")
        kept = _take_back_and_go_on(search, forward, resolution, test, "restarted")
    left = _left(kept.rounds)
    if (other := _other_beginning(forward[0])) is not None and left > MISFIT_SHARE * misfit(kept.rounds[0].baseline):
        report(f"once more, beginning with {other.accepted.candidate.name}")
        again = _select_again(search, forward, resolution, test, other)
        if again:
            others = _take_back_and_go_on(search, again, resolution, test, "again")
            other_left = _left(others.rounds)
            if other_left < CLEARLY_LESS * left and _implausible(others.members) <= _implausible(kept.members):
                kept, left = others, other_left
    final = kept.rounds[-1].baseline
    kept = with_rivals_compared(kept, resolution, report, workers)
    if kept.rounds[-1].baseline is not final:
        left = _left(kept.rounds)
    shares, free, free_gain = {}, (), 0.0
    if not kept.members or _is_unexplained(kept.rounds, kept.members, left):
        if kept.rounds[0].baseline is not calibrated:
            calibrated = kept.rounds[0].baseline
            test = ScoreTest(calibrated.fit, ())
        shares, free, free_gain = localise(kept.rounds, test, resolution, report, workers)
    if not kept.members and free and free_gain > MIN_CURVE_STRENGTH:
        end = round_with_effect_of_curve(kept.rounds[0], free[0], more, resolution)
        if end is not None:
            report(f"its law is that curve: {end.round.accepted.candidate.name}")
            again = _select_forward(search, end.baseline, resolution, test, [end.round], "curve")
            others = _take_back_and_go_on(search, again, resolution, test, "curve")
            others = with_rivals_compared(others, resolution, report, workers)
            if others.members:
                kept, left, shares, free, free_gain = others, _left(others.rounds), {}, (), 0.0
    rounds, after = kept.rounds, kept.rounds[-1].baseline
    campaign = after.fit.problem.campaign  # with the start of its records corrected
    before = campaign_residuals(campaign, campaign.machine, Instruments(), resolution.fine)
    report("what the error bars take for granted")
    assumed = tuple(assumed_parameters(after.fit, report))
    seconds = search.checkpoint.seconds
    return Diagnosis(
        campaign, tuple(rounds), before, rounds[0].baseline, after, seconds, tuple(kept.members), shares, tuple(free),
        left, free_gain, holdout_sentence, assumed, kept.rejected,
    )  # fmt: skip


def _select_forward(
    search: _Search, baseline: EvaluatedFit, resolution: TimeResolution, first: ScoreTest,
    begun: Sequence[Round] = (), name: str = "round",
) -> list[Round]:  # fmt: skip
    """Add one candidate after another until none is promising.

    Args:
        search: what all stages share.
        baseline: the model with the candidates of the rounds that are finished.
        resolution: coarse and fine time steps per sample.
        first: score test of the calibrated model.
        begun: the finished rounds.
        name: of the stages in the checkpoint.
    """
    rounds = list(begun)
    while True:
        mounted = mounted_candidates(rounds)
        end = search.round(
            f"{name}_{len(rounds) + 1}", mounted,
            lambda: _finish_round(search, baseline, rounds, resolution, first),  # noqa: B023 called at once
        )  # fmt: skip
        rounds.append(end.round)
        if end.baseline is None:
            return rounds
        search.report(stage_sentence(f"{FOUND}{end.round.accepted.candidate.name}", end.baseline))
        baseline = end.baseline


def _take_back_and_go_on(
    search: _Search, forward: Sequence[Round], resolution: TimeResolution, first: ScoreTest, name: str
) -> TakenBack:
    """The result of the backward pass; if that has removed the curve of a law, the search is continued once.

    Such a curve has fitted the influence of other effects, which the search could therefore not find.
    """
    kept = take_back(forward, resolution, search.report, search.workers)
    present = mounted_candidates(kept.rounds)
    ids = {candidate.id for candidate in present}
    removed = [c for c in mounted_candidates(forward) if isinstance(c, LawDeviation) and c not in present]
    if not any(curve.of in ids for curve in removed) or not _left(kept.rounds) > 0.0:
        return kept
    begun, model = kept.rounds[:-1], kept.rounds[-1].baseline
    on = _select_forward(search, model, resolution, first, begun, f"{name}_on")
    if len(on) == len(kept.rounds):
        return kept
    return take_back(on, resolution, search.report, search.workers).after(kept)


def _select_again(
    search: _Search, forward: Sequence[Round], resolution: TimeResolution, first: ScoreTest, other: Round
) -> list[Round]:
    """A search that begins with another round; empty where that one leaves more than the first of the known search."""
    end = search.round("again_1", [], lambda: _finish_round(search, forward[0].baseline, [], resolution, first, other))
    known = _left_after(forward[0], forward[1].baseline)
    if end.baseline is None or not _left_after(end.round, end.baseline) <= known:
        return []
    search.report(stage_sentence(CALIBRATED, forward[0].baseline))
    search.report(stage_sentence(f"{FOUND}{other.accepted.candidate.name}", end.baseline))
    return _select_forward(search, end.baseline, resolution, first, [end.round], "again")


def _is_much_better(found: EvaluatedFit, calibrated: EvaluatedFit) -> bool:
    """Whether `found`, a fit without effects too, has so small a cost that `calibrated` was a poor local minimum."""
    gain, scatter = calibrated.cost - found.cost, scatter_of_fits(calibrated)
    return gain > max(MIN_GAIN, BETTER_SHARE * remaining(calibrated.excess, calibrated.samples)) + scatter


def _left_after(found: Round, model: EvaluatedFit) -> float:
    """What the model after a round leaves, see `_left`."""
    return _left([found, Round(model, (), (), None)])


def _other_beginning(first: Round) -> Round | None:
    """The first round with the second best trial accepted; None where that is far behind.

    A law that differs much from that of the library may explain less at first than a wrong effect.
    """
    if first.accepted is None:
        return None
    samples = first.baseline.samples
    others = [t for t in first.trials if t is not first.accepted and is_promising(t, samples)]
    best = max(others, key=lambda trial: trial.own_law_gain, default=None)
    is_near = best is not None and best.own_law_gain > RUNNER_UP_SHARE * first.accepted.own_law_gain
    return dataclasses.replace(first, accepted=best, laws=()) if is_near else None


def _finish_round(
    search: _Search, baseline: EvaluatedFit, rounds: Sequence[Round], resolution: TimeResolution, first: ScoreTest,
    known: Round | None = None,
) -> RoundEnd:  # fmt: skip
    """Run the next round, or take `known` for it, and fit the model from which the round after it begins."""
    mounted = mounted_candidates(rounds)
    if sum(not isinstance(candidate, LawDeviation) for candidate in mounted) == MAX_EFFECTS:
        return RoundEnd(Round(baseline, (), (), None), None)
    candidates = search.candidates(baseline.fit.problem)
    curves = {candidate.of for candidate in mounted if isinstance(candidate, LawDeviation)}
    explained = gains_with_own_law(rounds)
    law_error = LAW_ERROR_SHARE * sum(explained[of] for of in curves) + scatter_of_fits(baseline)
    found = known or search_round(
        baseline, mounted, candidates, resolution, search.report, first, law_error, search.workers
    )
    return end_of_round(
        found, mounted, resolution, search.report, law_error, CURVES_TRIED if known is None else 1
    )


def _left(rounds: Sequence[Round]) -> float:
    """What the final model and deviations of its laws leave of ½χ², beyond the scatter of noise [nats]."""
    final, accepted = rounds[-1].baseline, mounted_candidates(rounds)
    if not accepted:
        return misfit(final)
    return remaining(final.excess_with(law_deviation_columns(final.fit, accepted)), final.samples)


def _implausible(members: Sequence[MemberTest]) -> int:
    """The number of members with a parameter whose fitted value is implausible."""
    return sum(bool(member.implausible) for member in members)


def _is_unexplained(rounds: Sequence[Round], members: Sequence[MemberTest], left: float) -> bool:
    """Whether so much is left, or so doubtfully explained, that its place is sought."""
    return any(member.implausible for member in members) or left > UNEXPLAINED_SHARE * misfit(rounds[0].baseline)
