"""What is hidden in a case, what a method answered to it, and when an answer is right.

A method answers with the names of what it says is missing, the most probable one first, with the set of names that it
does not rule out (`NOTHING` and `UNKNOWN` can be members), with a component of the machine, a verdict, and the
probability of its first name.

When a name is right, the same for all methods: it is the name of the hidden effect or sensor fault, whatever its law,
or the name of one that is the same for the sensors of a bench (`SAME_FOR_SENSORS`, fixed before the first case was
drawn). The rate "right name first, to the letter" allows no such name.
"""

import dataclasses
import enum
from collections.abc import Iterable
from typing import Any

from edhas_jax.machine.effects import LIBRARY, Effect

NOTHING, UNKNOWN = "nothing", "unknown"  # answers that are no names of effects
SENSOR_PLACE = "sensor"
# The plungers work in antiphase: what a leaking suction seat takes from the delivering chamber, a leaking delivery seat
# takes from the outlet into the filling chamber, at the same time and at the same pressure.
SAME_EFFECTS = (frozenset({"suction_seat_leakage", "delivery_seat_leakage"}),)
# A lag and a delay of a sensor differ by the square of frequency × time.
SAME_SENSOR_FAULTS = (frozenset({"sensor_lag", "sensor_delay"}),)


class Verdict(enum.Enum):
    """What a method concludes; the values are those of `diagnosis.json`."""

    ADEQUATE = "adequate"
    MISSING_EFFECT = "missing_effect"
    AMBIGUOUS = "ambiguous"
    UNKNOWN_EFFECT = "unknown_effect"


class Law(enum.Enum):
    """Whether the law of an effect is the one that the library has for its mechanism."""

    LIBRARY = "as in the library"
    DIFFERS = "differs"


@dataclasses.dataclass(frozen=True)
class HiddenEffect:
    """An effect or sensor fault that is hidden in a case.

    Args:
        name: its name among the suspects, such as `cogging_force` or `sensor_lag on current`.
        places: the components of the machine on which it acts; `sensor` for a sensor fault.
        law: whether it acts as in the library.
        values: its parameters (SI).
        visible: χ² in the fitted runs that the uncertain parameters cannot explain.
    """

    name: str
    places: tuple[str, ...]
    law: Law
    values: dict[str, float]
    visible: float


@dataclasses.dataclass(frozen=True)
class Truth:
    """What is hidden in a case.

    Args:
        family: letter of the family of generators.
        split: "tuning", "varied" or "judging".
        number: number of the case within family and split.
        hidden: what is hidden; nothing where only disturbances, sensor chains or settings differ.
        withheld: whether what is hidden is withheld from the suspects.
        disturbed_signals: signals whose sensors are not as the campaign says; a fault named there is not wrong.
        description: what else differs, in words.
        attempt: which of the draws of the case was the first one in which everything hidden is visible.
    """

    family: str
    split: str
    number: int
    hidden: tuple[HiddenEffect, ...] = ()
    withheld: bool = False
    disturbed_signals: tuple[str, ...] = ()
    description: str = ""
    attempt: int = 0

    @property
    def names(self) -> frozenset[str]:
        """The names of what is hidden."""
        return frozenset(h.name for h in self.hidden)

    @property
    def places(self) -> frozenset[str]:
        """The components on which something hidden acts."""
        return frozenset(place for h in self.hidden for place in h.places)

    @property
    def visible(self) -> float:
        """The χ² of the most visible hidden effect; 0 where nothing is hidden."""
        return max((h.visible for h in self.hidden), default=0.0)

    @property
    def right_answers(self) -> frozenset[str]:
        """The names that a set must hold at least one of."""
        if not self.hidden:
            return frozenset({NOTHING})
        return frozenset({UNKNOWN}) if self.withheld else frozenset().union(*map(same_names, self.names))


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a method says about a case.

    Args:
        verdict: its conclusion; None where the method ended in an error.
        named: what is missing, the most probable name first; empty where nothing is, or nothing with a name.
        answer_set: the names that are not ruled out as the first answer, with `NOTHING` and `UNKNOWN` as members.
        place: the component on which something is missing.
        probability: of the first answer, 0 … 1; None for a method that states none.
        law: for names in `named`, whether the law is the library's, where the method says so.
        ranked: the most probable names, whether or not they are answered.
        parameters: for each name, its parameters with their standard errors (SI, None at a limit), where stated.
        seconds: processor time, what several methods share included.
        failed: the error in which the method ended.
    """

    verdict: Verdict | None
    named: tuple[str, ...] = ()
    answer_set: tuple[str, ...] = ()
    place: str | None = None
    probability: float | None = None
    law: dict[str, Law] = dataclasses.field(default_factory=dict)
    ranked: tuple[str, ...] = ()
    parameters: dict[str, dict[str, tuple[float, float | None]]] = dataclasses.field(default_factory=dict)
    seconds: float = 0.0
    failed: str = ""

    @property
    def first(self) -> str:
        """The first name, `NOTHING` or `UNKNOWN`; empty for a method that failed."""
        if self.verdict is None:
            return ""
        if self.named:
            return self.named[0]
        return NOTHING if self.verdict is Verdict.ADEQUATE else UNKNOWN

    @property
    def members(self) -> frozenset[str]:
        """The members of the set; that of a method without sets is its first answer."""
        return frozenset(self.answer_set or ((self.first,) if self.first else ()))


def same_names(name: str) -> frozenset[str]:
    """The names that count as a name, itself among them."""
    kind, on, signal = name.partition(" on ")
    for group in SAME_SENSOR_FAULTS if on else SAME_EFFECTS:
        if kind in group:
            return frozenset(f"{other}{on}{signal}" for other in group)
    return frozenset({name})


def same_as_any(name: str, names: Iterable[str]) -> bool:
    """Whether a name counts as one of several names."""
    return not same_names(name).isdisjoint(names)


def places_of(name: str) -> tuple[str, ...]:
    """The components on which an effect or fault acts, by its name; empty for an unknown name."""
    if " on " in name:
        return (SENSOR_PLACE,)
    kinds = (*LIBRARY, *Effect.__subclasses__())  # those of machines of one's own too
    return next((tuple(dict.fromkeys(slot.location for slot in k.slots)) for k in kinds if k.id == name), ())


def truth_as_json(truth: Truth) -> dict[str, Any]:
    """A truth as plain data."""
    return _plain(dataclasses.asdict(truth))


def truth_from_json(plain: dict[str, Any]) -> Truth:
    """The truth of plain data."""
    hidden = tuple(
        HiddenEffect(h["name"], tuple(h["places"]), Law(h["law"]), h["values"], h["visible"]) for h in plain["hidden"]
    )
    return Truth(**plain | {"hidden": hidden, "disturbed_signals": tuple(plain["disturbed_signals"])})


def answer_as_json(answer: Answer) -> dict[str, Any]:
    """An answer as plain data."""
    return _plain(dataclasses.asdict(answer))


def answer_from_json(plain: dict[str, Any]) -> Answer:
    """The answer of plain data."""
    verdict = None if plain["verdict"] is None else Verdict(plain["verdict"])
    tuples = {n: tuple(plain[n]) for n in ("named", "answer_set", "ranked")}
    law = {name: Law(value) for name, value in plain["law"].items()}
    parameters = {
        name: {p: (value, error) for p, (value, error) in of.items()} for name, of in plain["parameters"].items()
    }
    return Answer(**plain | tuples | {"verdict": verdict, "law": law, "parameters": parameters})


def _plain(value: Any) -> Any:
    """Enumerations as their values and tuples as lists, at any depth."""
    if isinstance(value, enum.Enum):
        return value.value
    if isinstance(value, dict):
        return {n: _plain(v) for n, v in value.items()}
    return [_plain(v) for v in value] if isinstance(value, list | tuple) else value
