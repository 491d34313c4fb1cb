"""How good are the six numbers of the weight of a set (`WeightConstants`), and would others be better?

    python -m studies.hidden_effects.weights [--split varied|tuning] [--families b c …] [--first K] [--cases N]
                                             [--workers K] [--out DIR]

Each case is diagnosed once; the sets that were fitted are kept in DIR, so that the same command continues a study that
was stopped. Their weights are then computed again, with each number in turn smaller and larger. The score is the mean
log probability [nats] of the right answer: the sets that name what is hidden and nothing else, or, where that is
withheld, that hold a free term and name nothing; a fault of a sensor that is not as stated counts as neither. The best
step is taken as long as one raises the score; then each family is left out of that search in turn, and judged with what
the others say.

The last line: `cases=… score=… score_best=… score_left_out=… freedoms=… beyond_noise=… expected=… unknown_odds=…
law_error=… least_error=…`, the last six as they would be best.
"""

import argparse
import dataclasses
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rich.console import Console
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm
from edhas_jax.diagnosis.search.posterior import set_probabilities
from edhas_jax.diagnosis.search.result import Diagnosis
from edhas_jax.diagnosis.search.weight import WEIGHT, Weighing, WeightConstants
from studies.hidden_effects.answers import Truth, same_names
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, Split, keys_of
from studies.hidden_effects.store import read_json, write_json
from studies.hidden_effects.work import run_all

STEPS = (0.5, 1.0 / math.sqrt(2.0), math.sqrt(2.0), 2.0)  # factors on one number that are compared
LEAST_PROBABILITY = 1e-3  # of a right answer that no fitted set gives: one that was not found counts, but not all


@dataclasses.dataclass(frozen=True)
class Job:
    """A case to be diagnosed, and the file of its sets."""

    key: CaseKey
    file: Path


def run_job(job: Job) -> str:
    """Diagnose a case and store its sets; a sentence on them."""
    case = draw(job.key)
    found = edhas.diagnose(case.campaign, case.own_library, library=case.library)
    write_json(job.file, sets_as_json(found, case.truth))
    return f"{job.key}: {' + '.join(case.truth.names) or 'nothing'} → {found.posterior.best}"


def sets_as_json(found: Diagnosis, truth: Truth) -> dict[str, Any]:
    """The sets of a diagnosis with what their weights are made from, and whether each is the right answer."""
    weighing = found.weighing
    rows = [
        {
            "members": sorted(of.key), "free": sum(isinstance(c, FreeTerm) for c in of.members), "misfit": of.misfit,
            "numbers": of.numbers, "fall_by_laws": of.fall_by_laws,
            "right": is_right([(c.name, c.signal, isinstance(c, FreeTerm)) for c in of.members], truth),
        }
        for of in found.posterior.sets
    ]  # fmt: skip
    return {"named": weighing.named, "free": weighing.free, "samples": weighing.samples, "sets": rows}


def is_right(members: Sequence[tuple[str, str | None, bool]], truth: Truth) -> bool:
    """Whether a set is the right answer, see the module.

    Args:
        members: of each the name, the signal of a fault of a sensor, and whether it is a free term.
        truth: what is hidden.
    """
    has_free = any(is_free for *_, is_free in members)
    named = {name for name, signal, is_free in members if not is_free and signal not in truth.disturbed_signals}
    if truth.withheld:
        return has_free and not named
    hidden = [same_names(name) for name in truth.names]
    return not has_free and len(named) == len(hidden) and all(named & names for names in hidden)


def score(case: dict[str, Any], constants: WeightConstants) -> float:
    """The log probability of the right answer [nats] with some numbers."""
    weighing = Weighing(case["named"], case["free"], case["samples"], constants)
    for row in case["sets"]:
        kinds = [FreeTerm] * row["free"] + [Candidate] * (len(row["members"]) - row["free"])
        weighing.note(SimpleNamespace(**row | {"members": [kind(None) for kind in kinds]}))
    logs = [weighing.at(r["misfit"], len(r["members"]) - r["free"], r["free"]) for r in case["sets"]]
    misfits = {frozenset(row["members"]): row["misfit"] for row in case["sets"]}
    probabilities = set_probabilities(logs, [weighing.gain(key, misfits) for key in misfits])
    right = sum(p for p, row in zip(probabilities, case["sets"], strict=True) if row["right"])
    return math.log(max(right, LEAST_PROBABILITY))


def mean_score(cases: Sequence[dict[str, Any]], constants: WeightConstants) -> float:
    """The mean of the scores of some cases."""
    return sum(score(case, constants) for case in cases) / max(len(cases), 1)


def best_constants(cases: Sequence[dict[str, Any]]) -> WeightConstants:
    """The numbers with the largest mean score, from the present ones by one step of one of them at a time."""
    present, known = WEIGHT, mean_score(cases, WEIGHT)
    while True:
        names = [f.name for f in dataclasses.fields(WeightConstants)]
        others = [dataclasses.replace(present, **{n: s * getattr(present, n)}) for n in names for s in STEPS]
        scores = [mean_score(cases, other) for other in others]
        best = max(range(len(others)), key=scores.__getitem__)
        if not scores[best] > known + 1e-9:
            return present
        present, known = others[best], scores[best]


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", choices=[Split.VARIED.value, Split.TUNING.value], default=Split.VARIED.value)
    parser.add_argument("--families", nargs="+", choices=[f.value for f in Family], default=[], metavar="LETTER")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=8, help="how many numbers")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects_weights"))
    options = parser.parse_args(arguments)
    keys = keys_of(Split(options.split), options.families, options.first, options.cases)
    files = {key: options.out / options.split / f"{key}.json" for key in keys}
    waiting = [Job(key, file) for key, file in files.items() if not file.exists()]
    run_all(run_job, waiting, options.workers, options.out)
    cases = {key: read_json(file) for key, file in files.items()}
    report(cases)
    return 0


def report(cases: dict[CaseKey, dict[str, Any]]) -> None:
    """Print the scores of the present numbers and of others."""
    every, families = list(cases.values()), sorted({key.family for key in cases})
    table = Table("number", *(f"× {step:.2g}" for step in STEPS), title="change of the mean log probability [nats]")
    now = mean_score(every, WEIGHT)
    for field in dataclasses.fields(WeightConstants):
        value = getattr(WEIGHT, field.name)
        others = [dataclasses.replace(WEIGHT, **{field.name: step * value}) for step in STEPS]
        table.add_row(f"{field.name} = {value:g}", *(f"{mean_score(every, other) - now:+.3f}" for other in others))
    Console(width=120).print(table)
    best, left_out = best_constants(every), []
    for family in families if len(families) > 1 else ():
        of_others = best_constants([case for key, case in cases.items() if key.family != family])
        own = [case for key, case in cases.items() if key.family == family]
        left_out += [score(case, of_others) for case in own]
        print(f"family {family}: {mean_score(own, WEIGHT):.3f} now, {mean_score(own, of_others):.3f} by the others")
    numbers = " ".join(f"{name}={value:.3g}" for name, value in dataclasses.asdict(best).items())
    outside = sum(left_out) / len(left_out) if left_out else math.nan
    scores = f"score={now:.3f} score_best={mean_score(every, best):.3f} score_left_out={outside:.3f}"
    print(f"cases={len(every)} {scores} {numbers}")


if __name__ == "__main__":
    sys.exit(main())
