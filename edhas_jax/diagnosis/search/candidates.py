"""What may be missing: effects that could be mounted on a machine, and faults that its sensors could have."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.diagnosis.calibration.fit import Fit, FitProblem
from edhas_jax.machine.effects import LIBRARY, Effect, EffectError
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.slots import is_used
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.sensor_models import SensorDelay, SensorGain, SensorLag, SensorModel, SensorOffset
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter, relative_unknown

SENSOR_FAULTS: tuple[type[SensorModel], ...] = (SensorLag, SensorDelay, SensorGain, SensorOffset)
WIDTHS = 4.0  # a plausible range is that many standard deviations of the prior wide: ±2
BEYOND = 3.0  # standard deviations at which a value is no longer believed, of suspects and of known parameters alike
HELD = 0.05  # standard deviations from where belief ends: a value as near to it is held by it
OFFSET_SHARE = 0.05  # of a signal's range: what an offset of its sensor may be
SENSOR = "sensor"


@dataclasses.dataclass(frozen=True)
class Suspect:
    """One thing that may be missing: an effect, or a link in the measurement chain of `signal`."""

    kind: type[Effect] | type[SensorModel]
    signal: str | None = None

    @property
    def id(self) -> str:
        """The id of the effect."""
        return self.kind.id

    @property
    def name(self) -> str:
        """The id, with the signal where it is a sensor's."""
        return self.id if self.signal is None else f"{self.id} on {self.signal}"

    @property
    def where(self) -> str:
        """The part of the machine that it acts on."""
        return SENSOR if self.signal is not None else self.kind.slots[0].location

    @property
    def prefix(self) -> str:
        """What stands before the names of its parameters where they are sought."""
        return f"{self.id}." if self.signal is None else f"{self.signal}.{self.id}."

    def own(self, unknowns: Iterable[UnknownParameter]) -> dict[str, UnknownParameter]:
        """Those of the unknowns of a fit that are its parameters, by their bare names."""
        return {u.name.removeprefix(self.prefix): u for u in unknowns if u.name.startswith(self.prefix)}

    def searched(self) -> list[Parameter]:
        """The parameters whose values are not known beforehand."""
        return [p for p in structs.parameters(self.kind) if p.plausible is not None or p.name == "offset"]


def suspects_for(
    campaign: Campaign, machine: Rig, instruments: Instruments, more: Iterable[type[Effect]] = ()
) -> list[Suspect]:
    """Every effect of the library, and of `more`, that `machine` could have and lacks, and every fault of a sensor."""
    there = {effect.id for effect in machine.effects}
    able = [
        Suspect(kind) for kind in dict.fromkeys((*LIBRARY, *more)) if kind.id not in there and can_have(machine, kind)
    ]
    links = {(signal, type(link)) for signal, chain in instruments.chains.items() for link in chain}
    # half a sample of dead time is what tells one way of sampling a lag from another
    links |= {(signal, SensorDelay) for signal, kind in links if kind is SensorLag}
    return able + [
        Suspect(kind, signal)
        for signal in campaign.channels
        for kind in SENSOR_FAULTS
        if (signal, kind) not in links
    ]


def can_have(machine: Rig, kind: type[Effect]) -> bool:
    """Whether an effect has a place in a machine that is not taken, and what it acts on is there."""
    mounted = tuple(type(effect) for effect in machine.effects)
    return _can_have(type(machine), type(machine.amplifier), type(machine.controller), mounted, kind)


@functools.cache
def _can_have(rig, amplifier, controller, mounted, kind) -> bool:
    bare = rig(amplifier=amplifier(), controller=controller(), effects=tuple(effect() for effect in mounted))
    try:
        check_effect(kind(), bare)
    except EffectError:
        return False
    single = (slot for slot in kind.slots if slot.name in SINGLE)
    return set(kind.slots) <= set(rig.slots) and not any(is_used(slot, mounted) for slot in single)


# places that hold one effect only: a second coupling or line would have no meaning
SINGLE = ("coupling_force", "suction_line_resistance", "suction_line_flow", "outlet_line_flow")


def mounted(suspect: Suspect, machine: Rig, instruments: Instruments) -> tuple[Rig, Instruments]:
    """Machine and measurement chains with a suspect in place, its parameters at their defaults."""
    if suspect.signal is None:
        return structs.replace(machine, effects=(*machine.effects, suspect.kind())), instruments
    chain = (*instruments.chains.get(suspect.signal, ()), suspect.kind())
    return machine, Instruments({**instruments.chains, suspect.signal: chain})


def problem_of(
    campaign: Campaign, machine: Rig, instruments: Instruments, accepted: Iterable[Suspect],
    suspect: Suspect | None = None,
) -> FitProblem:  # fmt: skip
    """The fit of what is uncertain, of the effects `accepted` so far (mounted already), and of one more suspect."""
    accepted = list(accepted)
    if suspect is not None:
        machine, instruments = mounted(suspect, machine, instruments)
        accepted.append(suspect)
    own = [u for s in accepted for u in unknowns_of(s, campaign)]
    of_effects = {u.name.removeprefix(s.prefix) for s in accepted if s.signal is None for u in unknowns_of(s, campaign)}
    known = [
        believable(relative_unknown(machine, name, spread))
        for name, spread in campaign.uncertain_in(machine).items()
        if name not in of_effects
    ]
    return FitProblem(campaign, machine, (*known, *own), instruments)


def believable(unknown: UnknownParameter) -> UnknownParameter:
    """The unknown kept within what is believed of it, so that a parameter cannot stand in for physics."""
    low, high = (float(unknown.value(x)) for x in (-BEYOND, BEYOND))
    span = max(unknown.span[0], low), min(unknown.span[1], high)
    return dataclasses.replace(unknown, span=span)


def unknowns_of(suspect: Suspect, campaign: Campaign) -> list[UnknownParameter]:
    """A suspect's own parameters as unknowns: within the plausible range most of the time, never far beyond it.

    What the campaign itself says of a parameter goes before the range of the library.
    """
    out = []
    for p in suspect.searched():
        name = suspect.prefix + p.name
        if suspect.signal is None and p.name in campaign.uncertain:
            u = UnknownParameter(name, p.default, campaign.uncertain[p.name], p.unit, p.span)
        elif p.plausible is None:
            seen = [run.signals[suspect.signal] for run in campaign.runs if suspect.signal in run.signals]
            spread = OFFSET_SHARE * float(np.ptp(np.concatenate([v[np.isfinite(v)] for v in seen])))
            u = UnknownParameter(name, 0.0, spread, p.unit, p.span, ParameterScale.LINEAR)
        elif p.plausible[0] > 0.0:
            low, high = p.plausible
            u = UnknownParameter(name, math.sqrt(low * high), math.log(high / low) / WIDTHS, p.unit, p.span)
        else:
            low, high = p.plausible
            u = UnknownParameter(name, 0.5 * (low + high), (high - low) / WIDTHS, p.unit, p.span, ParameterScale.LINEAR)
        out.append(believable(u))
    return out


def held_by_belief(suspect: Suspect, fit: Fit) -> list[str]:
    """The parameters of a suspect that would go beyond all belief in a fit: it then only stands in for something."""
    at = {u.name: x for u, x in zip(fit.problem.unknowns, fit.x, strict=True)}
    own = suspect.own(fit.problem.unknowns)
    return [name for name, u in own.items() if u.has_prior and abs(at[u.name]) > BEYOND - HELD]


def grid(suspect: Suspect, unknowns: list[UnknownParameter]) -> np.ndarray:
    """Coordinates (k, n) that cover what a suspect may look like; the first unknown is its size, the rest its shape."""
    if len(unknowns) > 3:  # a law of its own, such as LuGre's: its typical form
        return np.zeros((1, len(unknowns)))
    points = {1: ((-1.5, -0.5, 0.5, 1.5),), 2: ((-1.2, 0.3), (-1.5, -0.5, 0.5, 1.5))}
    axes = points.get(len(unknowns), ((-0.5,), (-1.6, -1.1, -0.7, -0.3, 0.0, 0.4, 0.8, 1.3), (-1.7, -0.85, 0.0, 0.85)))
    return np.array(list(itertools.product(*axes))) if unknowns else np.zeros((1, 0))
