"""The answer of the package's own diagnosis, from what it writes into `diagnosis.json`.

What is read here is the same in versions 2 and 3 of that file, so that an earlier package can be compared.
"""

from collections.abc import Mapping
from typing import Any

from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.sets.posterior import NOTHING, UNKNOWN
from studies.hidden_effects.answers import Answer, Law, Verdict

VERDICTS_WITH_NAMES = (Verdict.MISSING_EFFECT, Verdict.AMBIGUOUS)
MAX_RANKED = 10


def answer_of(plain: Mapping[str, Any]) -> Answer:
    """The names, set, place, laws, verdict and probability of a diagnosis as plain data."""
    verdict, answer = Verdict(plain["verdict"]), plain["answer"]
    found = {_name(row["effect"], row.get("signal")): row for row in plain["candidates"] if row["accepted"]}
    found = {name: row for name, row in found.items() if row["effect"] in plain["effects"]}
    accepted = sorted(found, key=lambda name: (name != answer["first"], -answer["probabilities"].get(name, 0.0)))
    named = tuple(accepted) if verdict in VERDICTS_WITH_NAMES else ()
    place = None if verdict is Verdict.ADEQUATE or not plain["where"] else plain["where"][0]["slot"]
    laws = {_name(row["effect"], row["signal"]): Law(row["law"]) for row in plain["laws"]}
    parameters = {
        name: {n: (p["value"], p["std"]) for n, p in row["parameters"].items()} for name, row in found.items()
    }
    return Answer(
        verdict, named, tuple(answer["set"]), place, answer["probabilities"][answer["first"]],
        {name: laws[name] for name in named if name in laws}, tuple(answer["probabilities"])[:MAX_RANKED], parameters,
    )  # fmt: skip


def answer_of_sets(found) -> Answer:
    """The answer of a posterior over sets of effects: the set with the largest weight, and the sums over all sets.

    A cause without a name is reported where that set has a free term that explains more than any name in it.
    """
    from edhas_jax.diagnosis.sets.posterior import labels  # which an earlier version of the package does not have

    p, members = found.probabilities, [candidate for candidate, _ in found.members]
    if not members:
        (only,) = labels(found.sets[0])
        verdict = Verdict.ADEQUATE if only == NOTHING else Verdict.UNKNOWN_EFFECT
        return Answer(verdict, (), found.credible, None, p[only], ranked=tuple(p)[:MAX_RANKED])
    names = tuple(c.name for c in members if not isinstance(c, FreeTerm))
    is_unknown = isinstance(members[0], FreeTerm)
    verdict = Verdict.UNKNOWN_EFFECT if is_unknown else Verdict.MISSING_EFFECT
    first, named = (UNKNOWN, ()) if is_unknown else (names[0], names)
    return Answer(verdict, named, found.credible, members[0].location, p[first], ranked=tuple(p)[:MAX_RANKED])


def _name(effect: str, signal: str | None) -> str:
    return effect if signal is None else f"{effect} on {signal}"
