"""The answer of the package's own diagnosis, as the benchmark compares it with those of other methods.

The only module of the benchmark that reads a `Diagnosis`.
"""

from edhas_jax.diagnosis.search.result import Diagnosis
from studies.hidden_effects.answers import NOTHING, UNKNOWN, Answer, Verdict

VERDICTS_WITH_NAMES = (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)
MAX_RANKED = 10


def answer_of(diagnosis: Diagnosis) -> Answer:
    """The names, set, place, verdict and probability of a diagnosis."""
    verdict = Verdict(diagnosis.verdict.value)
    ranked = diagnosis.ranked_candidates()
    probabilities = {candidate.name: p for candidate, p, _ in ranked}
    named = tuple(t.candidate.name for t in diagnosis.accepted) if verdict in VERDICTS_WITH_NAMES else ()
    if named:
        groups = [[c.name for c in group] for group in diagnosis.confounded_groups()]
        answer_set = next((tuple(group) for group in groups if group[0] == named[0]), named[:1])
        probability = probabilities[named[0]]
    elif verdict is Verdict.ADEQUATE:
        answer_set, probability = (NOTHING,), diagnosis.rounds[-1].probabilities()[None]
    else:
        answer_set, probability = (UNKNOWN,), 1.0 - max(probabilities.values(), default=0.0)
    place = None if verdict is Verdict.ADEQUATE else next(iter(diagnosis.location_probabilities()), None)
    parameters = {
        t.candidate.name: {
            n.removeprefix(t.candidate.prefix): (value, diagnosis.final.standard_errors[n])
            for n, value in diagnosis.final.values.items()
            if n.startswith(t.candidate.prefix)
        }
        for t in diagnosis.accepted
    }
    return Answer(
        verdict, named, answer_set, place, float(probability), {}, tuple(probabilities)[:MAX_RANKED], parameters,
        diagnosis.seconds, details=tuple(diagnosis.sentences()),
    )  # fmt: skip
