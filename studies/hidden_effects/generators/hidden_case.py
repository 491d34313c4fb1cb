"""What determines a case, and the case itself: a synthetic campaign, and what is hidden in it."""

import dataclasses
import enum

import numpy as np

from edhas_jax.machine.effects import LIBRARY, Effect
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from studies.hidden_effects.answers import Truth


class Split(enum.Enum):
    """What a case may be used for."""

    TUNING = "tuning"  # to choose thresholds and methods
    VARIED = "varied"  # the same with laws, disturbances, chains and benches drawn at random
    JUDGING = "judging"  # to count right answers; nothing may be changed because of one of them

    @property
    def goes_by_number(self) -> bool:
        """Whether family, size and machine of a case follow from its number, as where answers are counted."""
        return self is not Split.VARIED


class Family(enum.Enum):
    """What makes a case difficult, by its letter; where answers are counted, cases are of the last four."""

    OTHER_LAWS = "b"  # a mechanism of the library acts by another law
    DISTURBANCES = "c"  # effects that are not in the library, with or without one of the library
    SENSOR_CHAINS = "d"  # recorder and sensors are not ideal, with or without an effect of the library
    SETTINGS = "e"  # settings and parameters are off, with or without an effect of the library
    SMALL_CAMPAIGNS = "f"  # few runs, few sensors, short records
    SEVERAL = "g"  # two or three effects, and one of the difficulties above
    WITHHELD = "h"  # the diagnosis may not use the mechanism, or the library has none
    NULLS = "n"  # nothing is hidden, and everything else is wrong
    PAIRS = "p"  # two or three effects, and any of the difficulties above
    SINGLES = "s"  # one effect or sensor fault, from what can just be seen to what is plain
    UNKNOWNS = "w"  # as WITHHELD, with any of the difficulties above


WITH_ANY_DIFFICULTY = (Family.NULLS, Family.PAIRS, Family.SINGLES, Family.UNKNOWNS)
# families of the cases that go by number: of 340 cases 100 have several effects, and 80 each belong to the others
ORDER = "pnswpnspwnpswnpsw"


@dataclasses.dataclass(frozen=True, order=True)
class CaseKey:
    """What determines a case: letter of the family, split and number."""

    family: str
    split: Split
    number: int

    def __str__(self):
        return f"{self.family}{self.number:05d}"


def keys_of(split: Split, families: list[str], first: int, count: int) -> list[CaseKey]:
    """The cases of some numbers: one of each family, or where the family follows from the number, that one if wanted.

    Args:
        split: the split.
        families: letters of families; none for all of the split.
        first: first number, 0 or more.
        count: how many numbers.
    """
    numbers = range(first, first + count)
    if split.goes_by_number:
        keys = [CaseKey(ORDER[n % len(ORDER)], split, n) for n in numbers]
        return [key for key in keys if not families or key.family in families]
    families = families or [f.value for f in Family if f not in WITH_ANY_DIFFICULTY]
    return [CaseKey(family, split, n) for family in families for n in numbers]


def key_of(truth: Truth) -> CaseKey:
    """The key from which the case with this truth is drawn again."""
    return CaseKey(truth.family, Split(truth.split), truth.number)


@dataclasses.dataclass(frozen=True)
class HiddenCase:
    """A synthetic campaign and the truth about it.

    Args:
        truth: what is hidden.
        campaign: what a method gets.
        library: the effects that a method may name: those of the library, or of the list of a machine of one's own,
            less those that are withheld.
        machine: the machine that made the data, with what is hidden mounted last.
        disturbances: size of each small disturbance by name.
        chain: links of the sensor chain, with their parameters.
        settings: what is off from run to run, and the sheet of parameters.
    """

    truth: Truth
    campaign: Campaign
    library: tuple[type[Effect], ...]
    machine: Rig | None = None
    disturbances: dict[str, float] = dataclasses.field(default_factory=dict)
    chain: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()

    @property
    def own_library(self) -> tuple[type[Effect], ...]:
        """Those effects that a method may name and that are not in the library of the package."""
        return tuple(kind for kind in self.library if kind not in LIBRARY)

    def is_same(self, other: Truth) -> bool:
        """Whether the same effects of the same sizes are hidden as another truth says."""
        pairs = zip(self.truth.hidden, other.hidden, strict=False)
        return len(self.truth.hidden) == len(other.hidden) and all(
            a.name == b.name and bool(np.isclose(a.visible, b.visible, rtol=0.01)) for a, b in pairs
        )
