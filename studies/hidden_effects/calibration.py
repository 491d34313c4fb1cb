"""Find the constants of the diagnosis's probabilities that make the right answers of development cases most probable.

    python -m studies.hidden_effects.calibration [--out DIR] [--families b c …] [--temperature]

The cases are those of the splits for development in DIR that `edhas diagnose` has answered (`python -m
studies.hidden_effects --split tuning --methods ours --out DIR`). Their evidence is stored with the answers, so that no
diagnosis is repeated.

The temperature also orders the trials of the search, so that with another one the search would find other evidence. It
is kept, unless `--temperature` asks for it; the cases must then be diagnosed again with what is found.

The constants are found by maximum likelihood with a weak prior around those of the package. Whether they hold for other
campaigns is tested by leaving out one family after the other: the constants are found without it, and its cases, with
another difficulty, are answered with them. The nominal coverage of the sets is that with which 95 % of these left-out
cases have the truth in their set (split conformal prediction: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random
World, 2005).

The last line: `cases=… loss=… loss_left_out=… first=… in_set=… set_size=… ece=…`. The rates are those on the
cases that were left out.
"""

import argparse
import dataclasses
import itertools
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from edhas_jax.diagnosis.search.answer import CONSTANTS, Constants, Evidence, Rivals, answer_from
from studies.hidden_effects.answers import (
    NOTHING,
    UNKNOWN,
    Answer,
    Truth,
    Verdict,
    answer_from_json,
    same_as_any,
    same_names,
    truth_from_json,
)
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.rates import Answered, first_is_right, mean_set_size, rate, set_is_right
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.store import CASE_FILE, ResultFolder, read_json

DEVELOPMENT = (Split.TUNING, Split.PRACTICE, Split.VARIED, Split.EARLIER)
TARGET = 0.95  # share of cases whose set holds the truth
COVERAGES = np.concatenate([np.linspace(0.5, 0.95, 19), np.linspace(0.955, 0.999, 12)])
SMALLEST_PROBABILITY = 1e-3  # of a right answer, in the loss
STRENGTHS = (0.0, 0.4, 0.7, 1.0, 2.5, 5.0, 15.0, 100.0, math.inf)  # limits of the bands
PRIOR_SPREAD = 0.7  # of the transformed constants around those of the package
TEMPERATURE = ("temperature", "temperature_share")  # what the search uses too
# constants that are positive are searched on a logarithmic scale, shares on a logistic one
POSITIVE = ("real_slope", "unknown_misfit_slope", "unknown_place_slope",
            "unknown_free_slope", "unknown_signal_slope", "unknown_distortion_slope")  # fmt: skip
SHARES = ("max_real", "max_nothing")  # too few cases tell the share of implausible values, which is kept
FREE = ("real_offset", "real_misfit_slope", "unknown_offset")
FITTED = (*POSITIVE, *SHARES, *FREE)


@dataclasses.dataclass(frozen=True)
class Case:
    """A development case and the evidence that the diagnosis found in it."""

    truth: Truth
    evidence: Evidence


def read_cases(folder: ResultFolder, families: Sequence[str] = ()) -> list[Case]:
    """The development cases of a folder that the diagnosis has answered, of all families or of some."""
    cases = []
    for path in sorted(p for split in DEVELOPMENT for p in (folder.folder / split.value).glob(f"*/{CASE_FILE}")):
        answer_file = path.parent / "ours.json"
        truth = truth_from_json(read_json(path))
        if not answer_file.exists() or (families and truth.family not in families):
            continue
        answer = answer_from_json(read_json(answer_file))
        if answer.evidence:
            cases.append(Case(truth, evidence_from(answer.evidence)))
    return cases


def evidence_from(plain: dict[str, Any]) -> Evidence:
    """The evidence of plain data."""
    return Evidence(**plain | {"members": tuple(Rivals(**member) for member in plain["members"])})


def right_probability(case: Case, constants: Constants) -> float:
    """The probability that an answer gives to what is right, the mean of several hidden effects."""
    found = answer_from(case.evidence, constants).probabilities
    if not case.truth.hidden or case.truth.withheld:
        return max(found.get(name, 0.0) for name in case.truth.right_answers)
    return float(np.mean([max(found.get(n, 0.0) for n in same_names(name)) for name in case.truth.names]))


def loss(cases: Sequence[Case], constants: Constants) -> float:
    """The mean of −ln of the probabilities of what is right."""
    right = [right_probability(case, constants) for case in cases]
    return float(-np.mean(np.log(np.maximum(right, SMALLEST_PROBABILITY))))


def best_constants(cases: Sequence[Case], start: Constants = CONSTANTS, names: Sequence[str] = FITTED) -> Constants:
    """The constants with the smallest loss and prior, of those with some names."""
    centre = np.array([_transformed(name, getattr(start, name)) for name in names])

    def objective(x: np.ndarray) -> float:
        prior = 0.5 * float(np.sum(np.square((x - centre) / PRIOR_SPREAD)))
        return len(cases) * loss(cases, with_values(x)) + prior

    def with_values(x: np.ndarray) -> Constants:
        values = {name: _constant(name, float(value)) for name, value in zip(names, x, strict=True)}
        return dataclasses.replace(start, **values)

    found = minimize(objective, centre, method="Powell", options={"maxiter": 30, "xtol": 1e-3, "ftol": 1e-4})
    return with_values(found.x)


def _transformed(name: str, value: float) -> float:
    """A constant on the scale on which it is searched."""
    if name in FREE:
        return value
    return math.log(value / (1.0 - value)) if name in SHARES else math.log(value)


def _constant(name: str, x: float) -> float:
    """A constant from its value on that scale."""
    if name in FREE:
        return x
    return 1.0 / (1.0 + math.exp(-x)) if name in SHARES else math.exp(min(x, 50.0))


def best_coverage(pairs: Sequence[tuple[Case, Constants]]) -> float:
    """The smallest nominal coverage with which the target share of cases have the truth in their set.

    The share is that of (n + 1) cases, the unseen one counting as wrong, as split conformal prediction demands.
    """
    for coverage in COVERAGES:
        held = [set_is_right(*answered_with(c, dataclasses.replace(k, coverage=float(coverage)))) for c, k in pairs]
        if sum(held) >= TARGET * (len(held) + 1):
            return float(coverage)
    return float(COVERAGES[-1])


def answered_with(case: Case, constants: Constants) -> Answered:
    """The case with the answer that follows from other constants."""
    found = answer_from(case.evidence, constants)
    p = found.probabilities[found.first]
    if found.first == NOTHING:
        return case.truth, Answer(Verdict.ADEQUATE, (), found.members, probability=p)
    if found.first == UNKNOWN:
        return case.truth, Answer(Verdict.UNKNOWN_EFFECT, (), found.members, probability=p)
    return case.truth, Answer(Verdict.MISSING_EFFECT, (found.first,), found.members, probability=p)


def real_by_strength(cases: Sequence[Case]) -> list[str]:
    """Sentences on how many accepted effects are there, or one of their rivals is, by their strength."""
    lines = []
    for low, high in itertools.pairwise(STRENGTHS):
        found = [
            not case.truth.withheld and any(same_as_any(name, case.truth.names) for name in member.gains)
            for case in cases
            for member in case.evidence.members
            if low < member.strength <= high
        ]
        lines.append(f"that explain {low:g} … {high:g} times what they leave: {sum(found)} of {len(found)} are there")
    return lines


def main(arguments: list[str] | None = None) -> int:
    """Find the constants from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    parser.add_argument("--families", nargs="+", default=[], help="families of the cases; all by default")
    parser.add_argument("--temperature", action="store_true",
                        help="also the temperature, with which the cases must be diagnosed again")  # fmt: skip
    options = parser.parse_args(arguments)
    names = (*TEMPERATURE, *FITTED) if options.temperature else FITTED
    cases = read_cases(ResultFolder(options.out), options.families)
    families = sorted({case.truth.family for case in cases})
    if len(families) < 2:
        print(f"{options.out}: development cases of two families at least are needed, with answers of `ours`",
              file=sys.stderr)  # fmt: skip
        return 1
    left_out: list[tuple[Case, Constants]] = []
    for family in families:
        found = best_constants([case for case in cases if case.truth.family != family], names=names)
        own = [case for case in cases if case.truth.family == family]
        left_out += [(case, found) for case in own]
        before, after = loss(own, CONSTANTS), loss(own, found)
        print(f"without family {family}: loss {before:.3f} → {after:.3f} on its {len(own)} cases")
    coverage = best_coverage(left_out)
    best = dataclasses.replace(best_constants(cases, names=names), coverage=coverage)
    print("\naccepted effects\n  " + "\n  ".join(real_by_strength(cases)))
    print("\nconstants of all cases")
    for field in dataclasses.fields(best):
        print(f"  {field.name} = {getattr(best, field.name):.4g}  (now {getattr(CONSTANTS, field.name):.4g})")
    print(_last_line(cases, left_out, coverage))
    return 0


def _last_line(cases: Sequence[Case], left_out: Sequence[tuple[Case, Constants]], coverage: float) -> str:
    pairs = [(case, dataclasses.replace(k, coverage=coverage)) for case, k in left_out]
    answered = [answered_with(case, k) for case, k in pairs]
    figures = {
        "cases": len(cases),
        "loss": loss(cases, CONSTANTS),
        "loss_left_out": float(np.mean([loss([case], k) for case, k in left_out])),
        "first": rate(answered, first_is_right).share,
        "in_set": rate(answered, set_is_right).share,
        "set_size": mean_set_size(answered),
        "ece": reliability(answered).error,
    }
    return " ".join(f"{name}={value:.4g}" for name, value in figures.items())


if __name__ == "__main__":
    raise SystemExit(main())
