"""Draw a case of any family, with its truth in the form that answers are compared with.

The only module of the driver that knows the generators. Family (a) are the cases of `cases.py`, whose number alone
determines them; the others come from the package `generators`.
"""

import dataclasses

from edhas_jax.machine.effects import LIBRARY, Effect
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from studies.hidden_effects import cases
from studies.hidden_effects.answers import HiddenEffect, Law, Truth, places_of
from studies.hidden_effects.generators.drawing import FIRST_LIBRARY_CASES, draw_case
from studies.hidden_effects.generators.hidden_case import Family, Hidden, HiddenCase, Split

LIBRARY_FAMILY = "a"
LAGS_SUFFIX = "_lags"  # of the name of a case in which every sensor has a small lag
FAMILIES = dict(zip("abcdefgh", Family, strict=True))


@dataclasses.dataclass(frozen=True, order=True)
class CaseKey:
    """What determines a case: letter of the family, split, number, and whether every sensor has a small lag."""

    family: str
    split: Split
    number: int
    sensor_lags: bool = False

    def __str__(self):
        return f"{self.family}{self.number:05d}{LAGS_SUFFIX if self.sensor_lags else ''}"


def key_of(truth: Truth) -> CaseKey:
    """The key from which the case with this truth is drawn again."""
    return CaseKey(truth.family, Split(truth.split), truth.number)


@dataclasses.dataclass(frozen=True)
class DrawnCase:
    """A campaign with what is hidden in it, the effects that a method may name, and the machine that made the data."""

    truth: Truth
    campaign: Campaign
    library: tuple[type[Effect], ...]
    machine: Rig | None = None


def first_number(family: str, split: Split) -> int:
    """The number of the first case of a family and split."""
    return FIRST_LIBRARY_CASES.get(split, 0) if family == LIBRARY_FAMILY else 0


def split_of(family: str, first: int, count: int, split: Split) -> Split:
    """The split of some cases; that of family (a) follows from the numbers.

    Raises:
        ValueError: the cases belong to several splits.
    """
    if family != LIBRARY_FAMILY:
        return split
    found = Split.TUNING
    for other, begin in FIRST_LIBRARY_CASES.items():
        if first < begin < first + count:
            raise ValueError(f"cases below {begin} are {found.value} cases, the others {other.value} ones: "
                             "do not mix them")  # fmt: skip
        found = other if first >= begin else found
    return found


def draw(key: CaseKey) -> DrawnCase:
    """Draw the case of a key.

    Raises:
        RuntimeError: nothing visible could be drawn.
    """
    if key.family == LIBRARY_FAMILY:
        return _library_case(key)
    case = draw_case(FAMILIES[key.family], key.split, key.number)
    withheld = {kind.id for kind in case.withheld}
    nameless = bool(case.hidden) and all(not h.candidate or h.candidate in withheld for h in case.hidden)
    truth = Truth(
        key.family, key.split.value, key.number, tuple(map(_hidden, case.hidden)), nameless, _disturbed(case),
        ": ".join(filter(None, (case.bench, case.description))),
    )  # fmt: skip
    return DrawnCase(truth, case.campaign, tuple(kind for kind in LIBRARY if kind.id not in withheld), case.machine)


def _hidden(hidden: Hidden) -> HiddenEffect:
    """A hidden effect; one that the library has no mechanism for has the name of its law."""
    is_of_library = hidden.law == hidden.candidate.partition(" on ")[0]
    law = Law.LIBRARY if is_of_library else Law.DIFFERS
    return HiddenEffect(hidden.candidate or hidden.law, hidden.locations, law, hidden.values, hidden.visible)


def _disturbed(case: HiddenCase) -> tuple[str, ...]:
    """The signals whose sensors are not as the campaign says."""
    return tuple(case.campaign.channels) if case.chain else ()


def _library_case(key: CaseKey) -> DrawnCase:
    case = cases.draw_case(key.number, key.sensor_lags)
    hidden = tuple(
        HiddenEffect(h.candidate.name, places_of(h.candidate.name), Law.LIBRARY, h.values, h.visible)
        for h in case.hidden
    )
    lags = tuple(case.campaign.channels) if key.sensor_lags else ()
    description = f"noise {case.noise_factor:g} times the usual one" + (", a lag of every sensor" if lags else "")
    truth = Truth(key.family, key.split.value, key.number, hidden, bool(case.withheld), lags, description)
    library = tuple(kind for kind in cases.PUMP_EFFECTS if kind not in case.withheld)
    return DrawnCase(truth, case.campaign, library)
