"""Small disturbances: effects that are not in the library, added together to a stated share of the noise."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import par, replace
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.rigs import Rig
from studies.hidden_effects.generators.sizes import draw_value
from studies.hidden_effects.generators.visibility import VisibilityTest

FEWEST, MOST = 3, 6  # disturbances of a case
LARGEST = 20.0  # size of a disturbance over its typical one
PHASE = (0.0, 6.28)  # rad; plausible phases of an oscillation
LEFT_OVER = (0.3, 1.5)  # rms over the noise of what they leave together, after the uncertain parameters are fitted


def size_par(unit: str, doc: str):
    """A parameter for the size of a disturbance, which is absent by default."""
    return par(0.0, unit, (-1e6, 1e6), doc)


def shape_par(default: float, unit: str, doc: str, plausible: tuple[float, float]):
    """Another parameter of a disturbance, drawn from its plausible range."""
    return par(default, unit, (-1e6, 1e6), doc, plausible=plausible)


@dataclasses.dataclass(frozen=True)
class Disturbance:
    """One kind of small disturbance, an effect of the machine that is not in the library.

    Args:
        kind: the effect that holds it; one effect holds many of them, so that all cases share their compiled programs.
        size: its size, a parameter of the effect that is 0 by default.
        shapes: further parameters of the effect that belong to it.
        typical: a size that is plausible (SI).
    """

    kind: type[Effect]
    size: str
    typical: float
    shapes: tuple[str, ...] = ()

    @property
    def id(self) -> str:
        """Its name."""
        return self.size


@dataclasses.dataclass(frozen=True)
class DrawnDisturbances:
    """The disturbances of a case.

    Args:
        sizes: size by id.
        machine: the machine with them.
        change: their change of the signals of the fitted runs, in units of noise.
        visible: what of it remains beside uncertain parameters and usual errors of a bench.
        left_over: its rms after the uncertain parameters are fitted, over the noise.
    """

    sizes: dict[str, float]
    machine: Rig
    change: np.ndarray
    visible: float
    left_over: float


def draw_disturbances(
    test: VisibilityTest, disturbances: Sequence[Disturbance], rng: np.random.Generator
) -> DrawnDisturbances | None:
    """Draw some kinds of disturbances and their sizes, such that together they leave a drawn share of the noise.

    Every kind alone leaves between a third and the whole of that share, or less where it would have to be larger than
    `LARGEST` times its typical size.

    Returns:
        The disturbances; None where the machine cannot be simulated with them, or where they leave too little.
    """
    usable = [c for c in disturbances if set(c.kind.slots) <= set(test.machine.slots)]
    count = min(int(rng.integers(FEWEST, MOST + 1)), len(usable))
    chosen = [usable[k] for k in rng.choice(len(usable), count, replace=False)]
    target = float(np.exp(rng.uniform(*np.log(LEFT_OVER))))
    holders = {c.kind: {} for c in usable}
    sizes: dict[str, float] = {}
    for disturbance in chosen:
        kind, shapes = disturbance.kind, disturbance.shapes
        holders[kind] |= {p.name: draw_value(p, rng) for p in structs.parameters(kind) if p.name in shapes}
    for disturbance in chosen:
        alone = _with(test.machine, holders, {disturbance: disturbance.typical})
        share = _left_over(test, test.change(alone))
        wanted = target * rng.uniform(1.0 / 3.0, 1.0)
        factor = min(wanted / share, LARGEST) if share > 0.0 else 0.0
        sizes[disturbance.id] = disturbance.typical * factor * float(rng.choice([-1.0, 1.0]))
    by_id = {c.id: c for c in chosen}
    for _ in range(3):  # not quite linear
        machine = _with(test.machine, holders, {by_id[n]: size for n, size in sizes.items()})
        change = test.change(machine)
        reached = _left_over(test, change)
        if not reached > 0.0 or abs(reached / target - 1.0) < 0.03:
            break
        factor = min(target / reached, 2.0)
        sizes = {n: size * factor for n, size in sizes.items()}
    if not LEFT_OVER[0] * 0.9 < reached < LEFT_OVER[1] * 1.1:  # not if it is not a number either
        return None
    return DrawnDisturbances(sizes, machine, change, test.all.visible(change), reached)


def _with(machine: Rig, holders: dict[type[Effect], dict[str, float]], sizes: dict[Disturbance, float]) -> Rig:
    values = {kind: dict(shapes) for kind, shapes in holders.items()}
    for disturbance, size in sizes.items():
        values[disturbance.kind][disturbance.size] = size
    effects = tuple(kind(**of_kind) for kind, of_kind in values.items())
    return replace(machine, effects=(*machine.effects, *effects))


def _left_over(test: VisibilityTest, change: np.ndarray) -> float:
    if not np.isfinite(change).all():
        return float("nan")
    return float(np.sqrt(test.parameters.visible(change) / len(change)))
