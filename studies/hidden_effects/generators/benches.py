"""A bench: which rig is run how, what is measured, and what the engineer is unsure of."""

import dataclasses
from collections.abc import Callable

from edhas_jax.machine.effects import Effect
from edhas_jax.machine.parameters import has_parameter, set_parameters
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Channel, Use
from studies.rk4_reference import LARGEST_RK4_STEP
from studies.synthetic_campaign import PlannedRun

# conditions that a computer sets, and one that is measured well enough
EXACT_CONDITIONS = ("frequency", "amplitude", "target.step_size", "ramp_time", "oil_temperature")


@dataclasses.dataclass(frozen=True)
class Bench:
    """A bench and its test plan.

    Args:
        id: its name.
        rig: makes the machine with some effects: its class, or that with drives.
        refined: effects that the engineer's model has.
        uncertain: relative standard deviations by parameter.
        channels: measured signals, with the usual noise.
        runs: the runs to be made.
        interval: sample interval [s].
        weight: how often it is drawn, relative to the others.
        known: parameters that differ from the nominal machine, which the engineer knows (SI); those of an effect that a
            model lacks are left out.
        step: largest time step [s] of the integrator that makes the records.
    """

    id: str
    rig: Callable[..., Rig]
    refined: tuple[type[Effect], ...]
    uncertain: dict[str, float]
    channels: dict[str, Channel]
    runs: tuple[PlannedRun, ...]
    interval: float
    weight: float
    known: dict[str, float] = dataclasses.field(default_factory=dict)
    step: float = LARGEST_RK4_STEP

    def machine(self, *without: type[Effect] | None) -> Rig:
        """The engineer's model, less some of its effects."""
        effects = tuple(kind() for kind in self.refined if kind not in without)
        machine = self.rig(effects=effects)
        known = {name: value for name, value in self.known.items() if has_parameter(machine, name)}
        return set_parameters(machine, known)

    @property
    def conditions(self) -> tuple[str, ...]:
        """The parameters that its runs set."""
        return tuple(dict.fromkeys(name for run in self.runs for name in run.conditions))

    @property
    def settings(self) -> tuple[str, ...]:
        """Those of them that a person or a valve sets, so that they are not exactly as stated."""
        return tuple(name for name in self.conditions if name not in EXACT_CONDITIONS)


def planned_runs(conditions: dict[str, float], *rows) -> tuple[PlannedRun, ...]:
    """Runs from rows of use ("fit" or "holdout"), duration [s], and a value for each of the conditions.

    Args:
        conditions: the SI value of the unit of each column, by parameter.
        rows: the runs.
    """
    return tuple(
        PlannedRun(Use(use), seconds, {n: unit * v for (n, unit), v in zip(conditions.items(), values, strict=True)})
        for use, seconds, *values in rows
    )
