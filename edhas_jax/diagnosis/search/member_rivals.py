"""Members of the final model against their rivals, with all other members in the model.

In its round, a candidate is compared with others while those that are accepted later are still missing. What these
explain then counts as left by all of them alike, which blunts the comparison, and may let the wrong one win. So that
every name is judged by what the final model leaves, the rivals of earlier rounds are fitted again in the place of the
member. A rival that leaves much less takes its place.
"""

import dataclasses
from collections.abc import Callable, Sequence

from edhas_jax.diagnosis.search.answer import log_weight, temperature
from edhas_jax.diagnosis.search.backward_pass import TakenBack, others_of, refit, take_back
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import remaining, unexplained_floor
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.law_deviation import law_deviation_columns
from edhas_jax.diagnosis.search.result import Round, mounted_candidates
from edhas_jax.diagnosis.search.selection_round import beyond_deviations, with_own_law
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.diagnosis.workers import Workers, fits_of
from edhas_jax.measurements.time_resolution import TimeResolution

MOST_RIVALS = 3  # of each member, the most probable ones first
LEAST_LOG_ODDS = -7.0  # against the member, by the comparison in its round; a rival below it is not fitted again
CLEARLY_LESS = 0.5  # what a rival leaves over what the member leaves, below which it takes the place of the member
MOST_EXCHANGES = 2

Report = Callable[[str], None]


def with_rivals_compared(
    taken: TakenBack, resolution: TimeResolution, report: Report, workers: Workers | None = None
) -> TakenBack:
    """Compare the members with the rivals of their rounds once more, and exchange those that a rival far surpasses.

    Args:
        taken: what the backward pass has left.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        workers: processes for the fits; None for this one.

    Returns:
        The same with the trials of earlier rounds as they are beside the other members, or, after an exchange, what the
        backward pass leaves of the new members. The round of the member that was accepted last is as it was.
    """
    for _ in range(MOST_EXCHANGES):
        if taken.rounds[-1].baseline.fit.problem.is_irregular:  # two fits then differ by chance, and each takes minutes
            break
        compared, exchanged = _compared(taken, resolution, report, workers)
        if exchanged is None:
            return compared
        again = take_back(exchanged, resolution, report, workers)
        taken = again._replace(rejected=(*taken.rejected, *again.rejected))
    return taken


def _compared(
    taken: TakenBack, resolution: TimeResolution, report: Report, workers: Workers | None
) -> tuple[TakenBack, list[Round] | None]:
    """The members with compared trials, and the rounds with the first member exchanged that a rival far surpasses."""
    rounds, final = list(taken.rounds), taken.rounds[-1].baseline
    mounted = mounted_candidates(rounds)
    for k, found in enumerate(rounds[:-2]):
        rivals = _close_rivals(found, mounted, final.samples)
        if not rivals:
            continue
        member = found.accepted
        others = others_of(mounted, member.candidate)
        values = final.fit.values
        models = [(others, values)] + [([*others, t.candidate], t.evaluated.fit.values | values) for t in rivals]
        sentences = [f"the other members without {member.candidate.name}"]
        sentences += [f"{t.candidate.name} in the place of {member.candidate.name}" for t in rivals]
        jobs = [(final, candidates, [start], resolution) for candidates, start in models]
        without, *fits = fits_of(refit, jobs, sentences, workers, report)
        if without is None:
            continue
        beside = [c for c in mounted if c is not member.candidate]
        trials = {member.candidate: _trial(member, without, final, others, beside)}
        for trial, fit in zip(rivals, fits, strict=True):
            if fit is not None:
                trials[trial.candidate] = _trial(trial, without, fit, others, others)
        for trial in trials.values():
            rounds[k] = rounds[k].with_trial(trial)
        best = min(trials.values(), key=lambda trial: trial.evaluated.excess)
        floors = [unexplained_floor(of.excess, final.samples) for of in (best.evaluated, final)]
        if best.candidate is not member.candidate and floors[0] < CLEARLY_LESS * floors[1]:
            report(f"{best.candidate.name} takes the place of {member.candidate.name}")
            return taken, _exchanged(rounds, k, best)
    return taken._replace(rounds=rounds), None


def _close_rivals(found: Round, mounted: Sequence[Candidate], samples: int) -> list[Trial]:
    """The trials that are no members themselves and were not far behind the accepted one, the most probable first."""
    accepted = found.accepted
    scale = temperature(accepted.mean_gain, remaining(accepted.own_law_excess, samples))

    def log_odds(trial: Trial) -> float:
        behind = min(trial.mean_gain - accepted.mean_gain, 0.0)
        return log_weight(behind, trial.determined_parameters, scale, prior_cost=trial.prior_cost) - log_weight(
            0.0, accepted.determined_parameters, scale, prior_cost=accepted.prior_cost
        )

    others = [t for t in found.trials if t.evaluated is not None and t.candidate not in mounted]
    close = [t for t in others if log_odds(t) > LEAST_LOG_ODDS]
    return sorted(close, key=log_odds, reverse=True)[:MOST_RIVALS]


def _trial(
    known: Trial, without: EvaluatedFit, fit: EvaluatedFit, others: Sequence[Candidate], beside: Sequence[Candidate]
) -> Trial:
    """A trial with another fit, compared with the model that has the `others` only; `beside` it are all the fit has."""
    deviations = law_deviation_columns(without.fit, others)
    compared = beyond_deviations(without, known.with_fit(without, fit), deviations)
    return with_own_law(without, beside, compared, deviations)


def _exchanged(rounds: Sequence[Round], k: int, best: Trial) -> list[Round]:
    """The rounds with another candidate accepted in one of them, and the model with it as the final one."""
    lost = rounds[k].accepted.candidate
    out = [dataclasses.replace(r, laws=tuple(law for law in r.laws if law.of != lost.id)) for r in rounds]
    out[k] = dataclasses.replace(out[k], accepted=best)
    out[-1] = dataclasses.replace(out[-1], baseline=best.evaluated)
    return out
