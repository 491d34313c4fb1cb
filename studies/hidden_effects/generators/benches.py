"""A bench: which rig is run how, what is measured, and what the engineer is unsure of."""

import dataclasses

from edhas_jax.machine.effects import Effect
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Channel
from edhas_jax.measurements.synthetic_campaign import PlannedRun

EXACT_CONDITIONS = ("frequency", "amplitude", "step_size", "ramp_time", "target.step_size", "reference.frequency")


@dataclasses.dataclass(frozen=True)
class Bench:
    """A bench and its test plan.

    Args:
        id: its name.
        rig: the class of the machine.
        refined: effects that the engineer's model has.
        uncertain: relative standard deviations by parameter.
        channels: measured signals, with the usual noise.
        runs: the runs to be made.
        interval: sample interval [s].
    """

    id: str
    rig: type[Rig]
    refined: tuple[type[Effect], ...]
    uncertain: dict[str, float]
    channels: dict[str, Channel]
    runs: tuple[PlannedRun, ...]
    interval: float


def settings_of(bench: Bench) -> list[str]:
    """The conditions of the runs that a person sets by hand, so that they are not exactly those that are stated."""
    return [n for n in dict.fromkeys(n for run in bench.runs for n in run.conditions) if n not in EXACT_CONDITIONS]
