"""A law: an effect of the truth, the mechanism of the library that it is a law of, and what sets its size."""

import dataclasses

from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.machine.effects import (
    CoilHeating,
    CouplingCompliance,
    Effect,
    EntrainedAir,
    KarnoppFriction,
    LugreFriction,
    MagneticSaturation,
    PistonLeakage,
)

MODEL_EFFECTS = (LugreFriction, PistonLeakage, EntrainedAir, KarnoppFriction)  # that the engineer's model usually has
# laws of the library whose effect falls with their first parameter
FALLING = (MagneticSaturation, CoilHeating, CouplingCompliance)


@dataclasses.dataclass(frozen=True)
class Law:
    """One law of a mechanism.

    Args:
        mechanism: the effect of the library that an engineer would name; None where the library has none.
        kind: the effect that acts; the mechanism itself for the law of the library.
        falling: whether it becomes smaller as its first parameter grows; known for those of the library.
    """

    mechanism: type[Effect] | None
    kind: type[Effect]
    falling: bool = False

    @property
    def id(self) -> str:
        """The id of the effect that acts."""
        return self.kind.id

    @property
    def free_parameters(self) -> list[Parameter]:
        """The parameters that differ from case to case."""
        return [p for p in structs.parameters(self.kind) if p.plausible is not None]

    @property
    def size(self) -> Parameter:
        """The parameter that sets the size: the first one."""
        return self.free_parameters[0]

    @property
    def falls(self) -> bool:
        """Whether the effect becomes smaller as that parameter grows."""
        return self.falling or self.kind in FALLING

    @property
    def locations(self) -> tuple[str, ...]:
        """The components of the machine on which it acts, sorted."""
        return tuple(sorted({slot.location for slot in self.kind.slots}))


def library_law(mechanism: type[Effect]) -> Law:
    """The law of the library itself."""
    return Law(mechanism, mechanism)
