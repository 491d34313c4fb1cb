"""Draw a case of any family, with its truth in the form that answers are compared with.

The only module of the driver that knows the generators.
"""

import dataclasses

from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from studies.hidden_effects import cases
from studies.hidden_effects.answers import HiddenEffect, Law, Truth, places_of

FAMILIES = {"a": "one effect, its law the library's, all else perfect"}
TUNING, JUDGING = "tuning", "judging"
SPLITS = (TUNING, JUDGING)


@dataclasses.dataclass(frozen=True, order=True)
class CaseKey:
    """What determines a case: letter of the family, split, number, and whether every sensor has a small lag."""

    family: str
    split: str
    number: int
    sensor_lags: bool = False

    def __str__(self):
        return f"{self.family}{self.number:05d}{'_lags' if self.sensor_lags else ''}"


@dataclasses.dataclass(frozen=True)
class DrawnCase:
    """A campaign with what is hidden in it, and the effects that a method may name."""

    truth: Truth
    campaign: Campaign
    library: tuple[type[Effect], ...]


def first_number(family: str, split: str) -> int:
    """The number of the first case of a family and split."""
    return cases.FIRST_TEST_CASE if family == "a" and split == JUDGING else 0


def split_of(family: str, first: int, count: int, split: str) -> str:
    """The split of some cases; that of family (a) follows from the numbers.

    Raises:
        ValueError: the cases belong to both splits.
    """
    if family != "a":
        return split
    if first < cases.FIRST_TEST_CASE < first + count:
        raise ValueError(
            f"cases below {cases.FIRST_TEST_CASE} are for development, the others for testing: do not mix them"
        )
    return TUNING if first < cases.FIRST_TEST_CASE else JUDGING


def draw(key: CaseKey) -> DrawnCase:
    """Draw the case of a key.

    Raises:
        RuntimeError: nothing visible could be drawn.
    """
    case = cases.draw_case(key.number, key.sensor_lags)
    hidden = tuple(
        HiddenEffect(h.candidate.name, places_of(h.candidate.name), Law.LIBRARY, h.values, h.visible)
        for h in case.hidden
    )
    lags = tuple(case.campaign.channels) if key.sensor_lags else ()
    description = f"noise {case.noise_factor:g} times the usual one" + (", a lag of every sensor" if lags else "")
    truth = Truth(key.family, key.split, key.number, hidden, bool(case.withheld), lags, description)
    library = tuple(kind for kind in cases.PUMP_EFFECTS if kind not in case.withheld)
    return DrawnCase(truth, case.campaign, library)
