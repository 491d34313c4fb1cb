"""The answer of the package's own diagnosis, from what it writes into `diagnosis.json`.

What is read here is the same in versions 2 and 3 of that file, so that an earlier package can be compared.
"""

from collections.abc import Mapping
from typing import Any

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


def _name(effect: str, signal: str | None) -> str:
    return effect if signal is None else f"{effect} on {signal}"
