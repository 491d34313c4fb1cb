"""The answer of the package's own diagnosis, as the benchmark compares it with those of other methods.

The only module of the benchmark that reads a `Diagnosis`.
"""

import dataclasses

from edhas_jax.diagnosis.search.conclusions import conclusions
from edhas_jax.diagnosis.search.result import Diagnosis
from studies.hidden_effects.answers import Answer, Law, Verdict

VERDICTS_WITH_NAMES = (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)
MAX_RANKED = 10


def answer_of(diagnosis: Diagnosis) -> Answer:
    """The names, set, place, law, verdict and probability of a diagnosis."""
    verdict, answer = Verdict(diagnosis.verdict.value), diagnosis.answer
    accepted = sorted(
        (t.candidate.name for t in diagnosis.named),
        key=lambda name: (name != answer.first, -answer.probabilities.get(name, 0.0)),
    )
    named = tuple(accepted) if verdict in VERDICTS_WITH_NAMES else ()
    place = None if verdict is Verdict.ADEQUATE else next(iter(diagnosis.location_probabilities()), None)
    laws = {m.candidate.name: Law.DIFFERS if m.law_differs else Law.LIBRARY for m in diagnosis.members}
    parameters = {
        t.candidate.name: {
            n.removeprefix(t.candidate.prefix): (value, diagnosis.final.standard_errors[n])
            for n, value in diagnosis.final.values.items()
            if n.startswith(t.candidate.prefix)
        }
        for t in diagnosis.named
    }
    return Answer(
        verdict, named, answer.members, place, float(answer.probabilities[answer.first]),
        {name: laws[name] for name in named}, tuple(answer.probabilities)[:MAX_RANKED], parameters, diagnosis.seconds,
        details=tuple(conclusions(diagnosis)), evidence=dataclasses.asdict(diagnosis.evidence),
        location_shares=diagnosis.location_shares,
    )  # fmt: skip
