"""Rates of right answers over the records of the benchmark, with Wilson's confidence intervals.

All rates are functions of the stored answers of one method. An answer that ended in an error counts as wrong: as a
wrong effect where nothing is hidden, as not found elsewhere. Cases that a method has not been run on are left out.

A case belongs to one of three kinds: *null*, where nothing is hidden although disturbances, sensor chains, settings or
parameters may differ; *withheld*, where what is hidden has no name among the suspects; *named*, where one or more
effects or sensor faults are hidden that a method can name.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

from studies.hidden_effects.answers import UNKNOWN, Answer, Truth, Verdict, same_as_any
from studies.hidden_effects.store import STANDS_OUT, Limit, Record

VISIBILITY_BANDS = (0.0, 60.0, 200.0, 1e3, 1e4, 1e5, math.inf)  # limits of χ²
STRENGTH_BANDS = (0.0, 0.3, 1.0, STANDS_OUT, 10.0, math.inf)  # limits of what an effect explains over what is left
MAX_RELATIVE_ERROR = 0.1  # a fitted parameter is right within this share of its true value,
MAX_STANDARD_ERRORS = 2.0  # or within this many of its standard errors


class Answered(NamedTuple):
    """A case with the answer of one method, and what the true laws explain in it, where that has been computed."""

    truth: Truth
    answer: Answer
    limit: Limit | None = None


@dataclasses.dataclass(frozen=True)
class Rate:
    """A number of right answers, and the number of cases."""

    right: int
    of: int

    @property
    def share(self) -> float:
        """Right answers over cases; NaN without cases."""
        return self.right / self.of if self.of else math.nan

    def interval(self, z: float = 1.96) -> tuple[float, float]:
        """Wilson's confidence interval, of 95 % by default: (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n)."""
        if not self.of:
            return 0.0, 1.0
        n, p = self.of, self.right / self.of
        half = z * math.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
        middle, whole = p + z * z / (2.0 * n), 1.0 + z * z / n
        return max(0.0, (middle - half) / whole), min(1.0, (middle + half) / whole)

    def __str__(self):
        if not self.of:
            return "–"
        low, high = self.interval()
        return f"{100 * self.share:.0f} % ({self.right}/{self.of}; {100 * low:.0f} … {100 * high:.0f})"


def answered(records: Iterable[Record], method: str) -> list[Answered]:
    """The cases that a method was run on, with its answers."""
    return [Answered(r.truth, r.answers[method], r.limit) for r in records if method in r.answers]


def answered_by_all(records: Iterable[Record], methods: Iterable[str]) -> list[Record]:
    """The cases that every one of these methods was run on, so that their rates can be compared."""
    needed = set(methods)
    return [record for record in records if needed <= record.answers.keys()]


def rate(cases: Iterable[Answered], right: Callable[[Truth, Answer], bool]) -> Rate:
    """The rate of cases for which `right` is true."""
    found = [right(truth, answer) for truth, answer, *_ in cases]
    return Rate(sum(found), len(found))


def is_null(truth: Truth) -> bool:
    """Whether nothing is hidden."""
    return not truth.hidden


def is_named(truth: Truth) -> bool:
    """Whether something is hidden that a method can name."""
    return bool(truth.hidden) and not truth.withheld


def first_is_right(truth: Truth, answer: Answer) -> bool:
    """Whether the first answer is: a hidden name, `nothing` where nothing is, `unknown` where the name is withheld."""
    return answer.first in truth.right_answers


def first_is_right_to_the_letter(truth: Truth, answer: Answer) -> bool:
    """Whether the first name is hidden under exactly this name."""
    return answer.first in truth.names


def set_is_right(truth: Truth, answer: Answer) -> bool:
    """Whether a right answer is in the set."""
    return not answer.members.isdisjoint(truth.right_answers)


def place_is_right(truth: Truth, answer: Answer) -> bool:
    """Whether something hidden acts on the component that a method states."""
    return answer.place in truth.places


def all_are_named(truth: Truth, answer: Answer) -> bool:
    """Whether every hidden name was answered."""
    return all(same_as_any(name, answer.named) for name in truth.names)


def names_exactly(truth: Truth, answer: Answer) -> bool:
    """Whether everything hidden was named, and nothing else."""
    return all_are_named(truth, answer) and len(answer.named) == len(truth.names)


def names_wrong_effect(truth: Truth, answer: Answer) -> bool:
    """Whether a name is answered that is not hidden; a fault of a sensor that has an unlisted one does not count."""
    if answer.verdict is None:
        return True
    return any(
        not same_as_any(name, truth.names) and name.partition(" on ")[2] not in truth.disturbed_signals
        for name in answer.named
    )


def is_unknown(truth: Truth, answer: Answer) -> bool:
    """Whether the answer is an effect without a name."""
    return answer.first == UNKNOWN


def law_flags(cases: Iterable[Answered]) -> Rate:
    """The rate of right statements on the laws of rightly named effects, of those that have one."""
    found = [
        answer.law[name] is h.law
        for truth, answer, *_ in cases
        for h in truth.hidden
        for name in answer.law
        if name in answer.named and same_as_any(name, (h.name,))
    ]
    return Rate(sum(found), len(found))


def right_parameters(cases: Iterable[Answered]) -> Rate:
    """The rate of fitted parameters close to their true values, for the rightly named effects of the library's law."""
    found = []
    for truth, answer, *_ in cases:
        for h in truth.hidden:
            for n, (value, error) in answer.parameters.get(h.name, {}).items():
                if n in h.values and error is not None:  # a value at its limit has no standard error
                    limit = max(MAX_RELATIVE_ERROR * abs(h.values[n]), MAX_STANDARD_ERRORS * error)
                    found.append(abs(value - h.values[n]) <= limit)
    return Rate(sum(found), len(found))


def mean_set_size(cases: Iterable[Answered]) -> float:
    """The mean number of members of the sets; NaN without any."""
    sizes = [len(answer.members) for _, answer, *_ in cases if answer.verdict is not None]
    return sum(sizes) / len(sizes) if sizes else math.nan


def rates(cases: Iterable[Answered]) -> dict[str, Rate]:
    """Every rate of the answers of one method, by its label."""
    cases = [Answered(*case) for case in cases]
    null, named = [c for c in cases if is_null(c.truth)], [c for c in cases if is_named(c.truth)]
    withheld = [c for c in cases if c.truth.withheld]
    unknown = [c for c in withheld if is_unknown(c.truth, c.answer)]
    out = {
        "right name first": rate(named, first_is_right),
        "right name first, to the letter": rate(named, first_is_right_to_the_letter),
        "truth in the set": rate(cases, set_is_right),
        "right place": rate(named, place_is_right),
    }
    for count, label in ((2, "both of two hidden effects named"), (3, "all three hidden effects named")):
        several = [c for c in named if len(c.truth.hidden) == count]
        out[label] = rate(several, all_are_named)
        known = [c for c in several if c.limit is not None]
        out[f"{label}, which stand out"] = rate((c for c in known if c.limit.all_stand_out), all_are_named)
        out[f"{label}, the rest"] = rate((c for c in known if not c.limit.all_stand_out), all_are_named)
    return out | {
        "all hidden effects named, and no other": rate(named, names_exactly),
        "a wrong effect named where one is hidden": rate(named, names_wrong_effect),
        "a wrong effect named where nothing is hidden": rate(null, names_wrong_effect),
        "`adequate` where nothing is hidden": rate(null, lambda t, a: a.verdict is Verdict.ADEQUATE),
        "effect withheld from the library reported as unknown": rate(withheld, is_unknown),
        "right place stated for an effect reported as unknown": rate(unknown, place_is_right),
        "right place stated for a withheld effect": rate(withheld, place_is_right),
        "right statement whether the law is that of the library": law_flags(named),
        "parameters right": right_parameters(named),
    }


def by_strength(cases: Iterable[Answered]) -> dict[tuple[float, float], Rate]:
    """The rate of hidden effects that are named, over what each explains beside the others, by limits of bands."""
    pairs = [
        (strength, same_as_any(h.name, c.answer.named))
        for c in cases
        if is_named(c.truth) and c.limit is not None
        for h, strength in zip(c.truth.hidden, c.limit.each, strict=True)
    ]
    bands = itertools.pairwise(STRENGTH_BANDS)
    found = {(low, high): [named for s, named in pairs if low <= max(s, 0.0) < high] for low, high in bands}
    return {band: Rate(sum(named), len(named)) for band, named in found.items()}


def by_visibility(cases: Iterable[Answered]) -> dict[tuple[float, float], Rate]:
    """The rate of right first names over the visible size of single hidden effects, by the limits of each band."""
    single = [c for c in cases if is_named(c[0]) and len(c[0].hidden) == 1]
    bands = itertools.pairwise(VISIBILITY_BANDS)
    return {(low, high): rate((c for c in single if low <= c[0].visible < high), first_is_right) for low, high in bands}


@dataclasses.dataclass(frozen=True)
class Times:
    """Computing times [s]: the median, the one that 95 % do not exceed, and the longest."""

    median: float
    most: float
    worst: float


def times(cases: Iterable[Answered]) -> Times:
    """The distribution of the computing times of some answers; NaN without any."""
    found = sorted(answer.seconds for _, answer, *_ in cases)
    if not found:
        return Times(math.nan, math.nan, math.nan)
    middle = 0.5 * (found[(len(found) - 1) // 2] + found[len(found) // 2])
    return Times(middle, found[math.ceil(0.95 * len(found)) - 1], found[-1])
