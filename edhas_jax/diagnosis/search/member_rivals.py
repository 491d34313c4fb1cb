"""The effects of the final model compared with their rivals, with all other effects in the model.

In each round of the search, the candidates are compared while the effects of later rounds are still missing. Their
influence is then a large misfit that no candidate explains, beside which the differences between candidates look small,
and a wrong one may be accepted. The comparison is therefore repeated in the final model: each close rival of an effect
is fitted in its place. A rival that leaves much less misfit replaces the effect.
"""

import dataclasses
from collections.abc import Callable, Sequence

from edhas_jax.diagnosis.search.backward_pass import TakenBack, others_of, refit, take_back
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import leaves_clearly_less, log_odds
from edhas_jax.diagnosis.search.law_deviation import law_deviation_columns
from edhas_jax.diagnosis.search.result import Round, mounted_candidates
from edhas_jax.diagnosis.search.selection_round import beyond_deviations, with_own_law
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.diagnosis.workers import Workers, fits_of
from edhas_jax.measurements.time_resolution import TimeResolution

MOST_RIVALS = 3  # maximum number of rivals of each effect that are fitted again: the most probable ones
LEAST_LOG_ODDS = -7.0  # a rival is fitted again if the logarithm of its odds against the effect is larger than this
MOST_EXCHANGES = 2  # maximum number of effects that are replaced by a rival

Report = Callable[[str], None]


def with_rivals_compared(
    taken: TakenBack, resolution: TimeResolution, report: Report, workers: Workers | None = None
) -> TakenBack:
    """Compare each effect of the final model with its rivals again; a rival with a much smaller misfit replaces it.

    Args:
        taken: result of the backward pass.
        resolution: coarse and fine time steps per sample.
        report: called with a sentence on the progress.
        workers: processes for the fits; None for this one.

    Returns:
        The result with repeated trials. Those of the last effect are not repeated, because all other effects were in
        the model when it was found. If an effect was replaced, the result of another backward pass.
    """
    for _ in range(MOST_EXCHANGES):
        if taken.rounds[-1].baseline.fit.problem.is_irregular:  # two fits then differ by chance, and each takes minutes
            break
        compared, exchanged = _compared(taken, resolution, report, workers)
        if exchanged is None:
            return compared
        taken = take_back(exchanged, resolution, report, workers).after(taken)
    return taken


def _compared(
    taken: TakenBack, resolution: TimeResolution, report: Report, workers: Workers | None
) -> tuple[TakenBack, list[Round] | None]:
    """The result with repeated trials; and, if an effect is to be replaced, the rounds with its replacement."""
    rounds, final = list(taken.rounds), taken.rounds[-1].baseline
    mounted = mounted_candidates(rounds)
    for k, found in enumerate(rounds[:-2]):
        rivals = _close_rivals(found, mounted, final.samples)
        if not rivals:
            continue
        member = found.accepted
        name, others = member.candidate.name, others_of(mounted, member.candidate)
        jobs = [(final, others, [final.fit.values], resolution)]
        sentences = [f"the other effects without {name}"]
        for rival in rivals:
            start = rival.evaluated.fit.values | final.fit.values
            jobs.append((final, [*others, rival.candidate], [start], resolution))
            sentences.append(f"{rival.candidate.name} in the place of {name}")
        without, *fits = fits_of(refit, jobs, sentences, workers, report)
        if without is None:
            continue
        deviations = law_deviation_columns(without.fit, others)
        beside_member = [c for c in mounted if c is not member.candidate]  # with the curve of its law
        models = [(member, final, beside_member), *((t, fit, others) for t, fit in zip(rivals, fits, strict=True))]
        trials = []
        for trial, fit, beside in models:
            if fit is not None:
                trial = beyond_deviations(without, trial.with_fit(without, fit), deviations)
                trials.append(with_own_law(without, beside, trial, deviations))
                rounds[k] = rounds[k].with_trial(trials[-1])
        best = min(trials, key=lambda trial: trial.evaluated.excess)
        if leaves_clearly_less(best.evaluated, final):
            report(f"{best.candidate.name} takes the place of {name}")
            return taken, _exchanged(rounds, k, best)
    return taken._replace(rounds=rounds), None


def _close_rivals(found: Round, mounted: Sequence[Candidate], samples: int) -> list[Trial]:
    """The trials of a round not much less probable than the accepted one; none of a candidate that is in the model."""
    others = [t for t in found.trials if t.evaluated is not None and t.candidate not in mounted]
    odds = {t.candidate: log_odds(t, found.accepted, samples) for t in others}
    close = [t for t in others if odds[t.candidate] > LEAST_LOG_ODDS]
    return sorted(close, key=lambda t: -odds[t.candidate])[:MOST_RIVALS]


def _exchanged(rounds: Sequence[Round], k: int, best: Trial) -> list[Round]:
    """The rounds after `best` has replaced the accepted trial of round k; the final model is that of `best`."""
    lost = rounds[k].accepted.candidate
    out = [dataclasses.replace(r, laws=tuple(law for law in r.laws if law.of != lost.id)) for r in rounds]
    out[k] = dataclasses.replace(out[k], accepted=best)
    out[-1] = dataclasses.replace(out[-1], baseline=best.evaluated)
    return out
