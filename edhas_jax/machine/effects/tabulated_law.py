"""Effects given by a table: the contribution to a slot as a curve over one signal, without any code of a user.

The curve passes through the values at the nodes. Between two nodes it is a cubic Hermite polynomial whose slope at a
node is that of the chord between the neighbouring nodes; outside the nodes it is constant. It is linear in the values.
"""

import dataclasses
import functools
import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from edhas_jax.compiler.one_sided_minmax import one_sided_max, one_sided_min
from edhas_jax.core.source_location import is_users_code
from edhas_jax.core.structs import par
from edhas_jax.machine.effects.base import Effect, EffectError
from edhas_jax.machine.interface.signals import SIGNALS, Signals, UnknownNameError
from edhas_jax.machine.interface.slots import SLOTS, Rule, Slot

MIN_NODES, MAX_NODES = 2, 100
LIMITS = (-1e30, 1e30)  # of nodes and values, SI
SMALLEST_WIDTH = 1e-30  # of an interval; keeps a table finite whose nodes have been changed to coincide

# SI units of what is known at some slots beside the signals of the whole machine
_FURTHER_UNITS = {
    "sliding_position": "m", "sliding_velocity": "m/s", "coupling_deflection": "m", "coupling_velocity": "m/s",
    "lift": "m", "lift_velocity": "m/s", "pressure_drop": "Pa", "valve_area": "m^2", "chamber_pressure": "Pa",
    "plunger_velocity": "m/s", "viscosity": "Pa*s", "pressure": "Pa", "cylinder_free_force": "N",
    "cylinder_friction_level": "N",
}  # fmt: skip
LAW_SIGNALS: dict[str, str] = {n: s.unit for n, s in SIGNALS.items()} | _FURTHER_UNITS
"""SI unit of every signal over which a law can be tabulated, by name."""


class LawPlace(NamedTuple):
    """Where a tabulated law acts: contribution = curve(variable) · product of the factors.

    Attributes:
        slot: name of the slot.
        variable: signal over which the curve is given.
        factors: signals by which the curve is multiplied; most laws have none.
        rig: the rig of one's own that declares the slot; None for the slots and signals of the package.
    """

    slot: str
    variable: str
    factors: tuple[str, ...] = ()
    rig: Any = None

    @property
    def declaration(self) -> Slot:
        """The slot."""
        return slots_of(self.rig)[self.slot]

    @property
    def variable_unit(self) -> str:
        """SI unit of the variable."""
        return law_signals(self.rig)[self.variable]

    @property
    def value_unit(self) -> str:
        """SI unit of the curve's values: that of the slot, divided by those of the factors."""
        return quotient_unit(self.declaration.unit, [law_signals(self.rig)[n] for n in self.factors])

    @property
    def neutral(self) -> float:
        """The value at which the law has no influence: 1 for a factor, 0 for a term that is added."""
        return 1.0 if self.declaration.rule is Rule.SCALE else 0.0


def rig_of(machine: Any) -> Any:
    """What `LawPlace.rig` is on a machine."""
    return type(machine) if is_users_code(type(machine)) else None


def slots_of(rig: Any) -> dict[str, Slot]:
    """The slots at which a law can act by name, on a rig of one's own or, with None, on those of the package."""
    return SLOTS if rig is None else {slot.name: slot for slot in rig.slots}


def law_signals(rig: Any) -> dict[str, str]:
    """SI unit of every signal over which a law can be tabulated, by name; for `rig` see `slots_of`."""
    return LAW_SIGNALS if rig is None else LAW_SIGNALS | {n: about.unit for n, about in rig.signals.items()}


def quotient_unit(unit: str, divisors: Sequence[str]) -> str:
    """A unit divided by others, as text: "N" and "Pa" give "N/Pa"."""
    for divisor in divisors:
        is_simple = divisor.isalpha()
        numerator = "1" if unit == "-" else unit if is_simple or unit.isalpha() else f"({unit})"
        unit = f"{numerator}/{divisor if is_simple else f'({divisor})'}"
    return unit


@dataclasses.dataclass(frozen=True, eq=False)
class LawTable:
    """A law as a table of numbers.

    Attributes:
        name: id of the effect.
        place: where it acts.
        nodes: values (n,) of the variable, increasing, SI.
        values: values (n,) of the curve, SI.
        std: standard errors (n,) of the values, SI, for information; None where they are not known.
        origin: where the table comes from.
    """

    name: str
    place: LawPlace
    nodes: np.ndarray
    values: np.ndarray
    std: np.ndarray | None = None
    origin: str = ""

    def effect(self) -> Effect:
        """The effect that contributes this law."""
        rows = enumerate(zip(self.nodes, self.values, strict=True), 1)
        numbers = {f"{what}_{k}": float(v) for k, row in rows for what, v in zip(("node", "value"), row, strict=True)}
        return tabulated_class(self.name, self.place, len(self.nodes))(**numbers)


def table_of(effect: Effect) -> LawTable | None:
    """The table of an effect; None for an effect that is not tabulated."""
    place = getattr(type(effect), "_place", None)
    if place is None:
        return None
    count = type(effect)._count
    nodes, values = (np.array([float(v) for v in _numbers(effect, what, count)]) for what in ("node", "value"))
    return LawTable(effect.id, place, nodes, values)


@functools.cache
def tabulated_class(name: str, place: LawPlace, count: int) -> type[Effect]:
    """The class of an effect that contributes a curve through `count` nodes.

    Nodes and values are its parameters `node_1` … and `value_1` …, so that no change of a number compiles anything.

    Args:
        name: id of the effect.
        place: where it acts.
        count: number of nodes.

    Raises:
        EffectError: unknown slot or signal, or a number of nodes that is not supported.
    """
    if place.slot not in slots_of(place.rig):
        raise EffectError(f"no slot `{place.slot}`")
    unknown = [n for n in (place.variable, *place.factors) if n not in law_signals(place.rig)]
    if unknown:
        raise EffectError(f"no law can be tabulated over `{unknown[0]}`")
    if not MIN_NODES <= count <= MAX_NODES:
        raise EffectError(f"a tabulated law has {MIN_NODES} to {MAX_NODES} nodes, not {count}")

    def contribute(self, s: Signals, z):
        try:
            variable, *factors = (getattr(s, n) for n in (place.variable, *place.factors))
        except UnknownNameError as error:
            raise EffectError(
                f"{name}: the signal `{error.name}` is not known at the slot {place.slot} of this machine"
            ) from None
        value = interpolate(variable, _numbers(self, "node", count), _numbers(self, "value", count))
        for factor in factors:
            value = value * factor
        return value

    variable_unit, value_unit = place.variable_unit, place.value_unit
    numbers = {
        f"node_{k}": par(
            float(k), variable_unit, LIMITS, f"node {k} of the table, {place.variable}",
            at_least=f"node_{k - 1}" if k > 1 else "",
        )
        for k in range(1, count + 1)
    }  # fmt: skip
    numbers |= {
        f"value_{k}": par(place.neutral, value_unit, LIMITS, f"value of the law at node {k}")
        for k in range(1, count + 1)
    }
    over = " · ".join((f"curve over {place.variable}", *place.factors))
    body = numbers | {
        "__annotations__": dict.fromkeys(numbers, float),
        "__module__": __name__,
        "__doc__": f"Tabulated law at the slot {place.slot}: {over}.\n\nSource: a table of {count} nodes.",
        "id": name,
        "looks_like": "whatever its table says",
        "_place": place,
        "_count": count,
        "_generated_by": (tabulated_class, (name, place, count)),
        place.slot: contribute,
    }
    # compiled loops are cached by the name of the class, so it holds all that the program depends on
    words = ("tabulated", name, place.slot, "over", place.variable, *place.factors, str(count))
    return type("".join(part.title() for part in "_".join(words).split("_")), (Effect,), body, rig=place.rig)


def interpolate(x, nodes: list, values: list):
    """The curve of a table at `x`.

    All numbers are scalars, because a loop in machine code holds no arrays.

    Args:
        x: where the curve is wanted.
        nodes: n numbers, increasing.
        values: n numbers.
    """
    widths = [one_sided_max(high - low, SMALLEST_WIDTH) for low, high in itertools.pairwise(nodes)]
    rises = [after - before for before, after in itertools.pairwise(values)]
    pairs = zip(itertools.pairwise(rises), itertools.pairwise(widths), strict=True)
    chords = [(rise_before + rise_after) / (before + after) for (rise_before, rise_after), (before, after) in pairs]
    slopes = [rises[0] / widths[0], *chords, rises[-1] / widths[-1]]
    intervals = []
    for k, (width, rise) in enumerate(zip(widths, rises, strict=True)):
        first, last = width * slopes[k], width * slopes[k + 1]
        coefficients = values[k], first, 3.0 * rise - 2.0 * first - last, first + last - 2.0 * rise
        intervals.append((nodes[k], 1.0 / width, *coefficients))
    chosen = intervals[0]
    for interval in intervals[1:]:
        here = x >= interval[0]
        chosen = [jnp.where(here, new, old) for new, old in zip(interval, chosen, strict=True)]
    low, inverse_width, value, linear, quadratic, cubic = chosen
    # at a node the derivative is that of the interval to its right
    t = one_sided_max(0.0, one_sided_min((x - low) * inverse_width, 1.0))
    return value + t * (linear + t * (quadratic + t * cubic))


def _numbers(effect: Effect, what: str, count: int) -> list:
    return [getattr(effect, f"{what}_{k}") for k in range(1, count + 1)]


def signals_at(slot: Slot, rig: Any = None) -> tuple[str, ...]:
    """Names of the signals over which a law at a slot can be tabulated: those of the slot first."""
    own = SIGNALS if rig is None else rig.signals
    elsewhere = {n for other in SLOTS.values() for n in other.local_signals} - own.keys()
    return (*slot.local_signals, *(n for n in law_signals(rig) if n not in {*slot.local_signals, *elsewhere}))
