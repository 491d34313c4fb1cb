"""Candidate explanations of a misfit: effects that a machine may lack, faults of its sensors, and free terms."""

import dataclasses
import functools
import itertools
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import Parameter
from edhas_jax.diagnosis.laws.added_terms import AddedTerm
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_problem import CALIBRATION_BOUND, FitProblem, limit_to_prior_bound
from edhas_jax.inference.fit.starts import spread_points
from edhas_jax.inference.likelihood.bench_deviations import bench_deviations
from edhas_jax.machine.effects import LIBRARY, Effect, EffectError
from edhas_jax.machine.effects.tabulated_law import LawPlace
from edhas_jax.machine.effects.validation import check_effect
from edhas_jax.machine.interface.slots import is_used
from edhas_jax.machine.rig_base import KindOfMachine, Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.sensor_models import SensorDelay, SensorGain, SensorLag, SensorModel, SensorOffset
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter, with_prior

SENSOR_FAULTS: tuple[type[SensorModel], ...] = (SensorLag, SensorDelay, SensorGain, SensorOffset)
SENSOR_LOCATION = "sensor"
# end and width of a plausible range in standard deviations of the prior
PLAUSIBLE_COORDINATE, PLAUSIBLE_RANGE_SIGMAS = 2.0, 4.0
MOST_ON_GRID = 3  # parameters of a law whose signatures are taken on a grid; those of one with more at spread points:
SPREAD_POINTS, SPREAD_HALF_WIDTH = 32, 1.5  # their number, and their range in prior standard deviations
USUAL_COORDINATE = 1.5  # of a number of a free term, in standard deviations of its prior


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One possible cause of a misfit: an effect of the machine, or a link in the measurement chain of `signal`.

    Args:
        kind: class of the effect, or of the sensor fault.
        signal: name of the signal whose sensor is at fault; None for an effect.
    """

    kind: type[Effect] | type[SensorModel]
    signal: str | None = None

    @property
    def id(self) -> str:
        """The id of the effect or sensor fault."""
        return self.kind.id

    @property
    def name(self) -> str:
        """The id, followed by the signal for a sensor fault."""
        return self.id if self.signal is None else f"{self.id} on {self.signal}"

    @property
    def title(self) -> str:
        """What it is for a reader: its name, or for a free term where it acts and over what."""
        return self.name

    @property
    def location(self) -> str:
        """The component of the machine on which it acts; "sensor" for a sensor fault."""
        return SENSOR_LOCATION if self.signal is not None else self.kind.slots[0].location

    @property
    def memory_of(self) -> str:
        """The signal on whose past its law depends; empty for another law, and for a curve or a fault of a sensor."""
        return getattr(self.kind, "memory_of", "")

    @property
    def prefix(self) -> str:
        """The prefix of the names of its parameters among the unknowns of a fit."""
        return f"{self.id}." if self.signal is None else f"{self.signal}.{self.id}."

    def own_unknowns(self, unknowns: Iterable[UnknownParameter]) -> dict[str, UnknownParameter]:
        """Select the unknowns of a fit that are parameters of this candidate, by their names without the prefix."""
        return {u.name.removeprefix(self.prefix): u for u in unknowns if u.name.startswith(self.prefix)}

    def own_coordinates(self, fit: Fit) -> dict[str, float]:
        """The fitted coordinates of its parameters that have a prior, by their names without the prefix."""
        known = {u.name: x for u, x in zip(fit.problem.unknowns, fit.x, strict=True)}
        own = self.own_unknowns(fit.problem.unknowns)
        return {name: float(known[u.name]) for name, u in own.items() if u.has_prior}

    def free_parameters(self) -> list[Parameter]:
        """The parameters that a fit has to estimate: those with a plausible range."""
        return [p for p in structs.parameters(self.kind) if p.plausible is not None or self.has_unit_of_signal]

    @property
    def has_unit_of_signal(self) -> bool:
        """Whether its parameter has the unit and a share of the range of the signal, as a sensor offset."""
        return self.signal is not None and self.kind.plausible_share is not None

    def unit(self, unknown: UnknownParameter, machine: Rig) -> str:
        """The SI unit of one of its unknowns."""
        return machine.signals[self.signal].unit if self.has_unit_of_signal else unknown.unit

    def sizes(self) -> list[Parameter]:
        """The parameters that vanish together where the effect is absent.

        The first one, those that may be zero, and those that are at least the first one. The others are its shape.
        """
        own = self.free_parameters()
        return [p for k, p in enumerate(own) if k == 0 or p.span[0] <= 0.0 or p.at_least == own[0].name]

    def mounted(self, machine: Rig, instruments: Instruments) -> tuple[Rig, Instruments]:
        """The machine, or the chain of its signal, with this candidate added, its parameters at their defaults."""
        if self.signal is None:
            return structs.replace(machine, effects=(*machine.effects, self.kind())), instruments
        chain = (*instruments.chains.get(self.signal, ()), self.kind())
        return machine, Instruments({**instruments.chains, self.signal: chain})

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The free parameters as unknowns of a fit, with their priors.

        The plausible range of the library is taken as ±2 standard deviations of the prior: log-normal where the range
        is positive, else normal. A standard deviation stated by the campaign takes precedence. The range of a sensor
        fault in the unit of its signal is a share of the measured range. All are limited to the prior bound.
        """
        out, extent = [], 1.0
        if self.has_unit_of_signal:
            measured = [run.signals[self.signal] for run in campaign.runs if self.signal in run.signals]
            extent = float(np.ptp(np.concatenate([v[np.isfinite(v)] for v in measured])))
        for p in self.free_parameters():
            name = self.prefix + p.name
            low, high = p.plausible or (extent * share for share in self.kind.plausible_share)
            if self.signal is None and p.name in campaign.uncertain:
                u = with_prior(p, name, p.default, campaign.uncertain[p.name])
            elif low > 0.0:
                spread = math.log(high / low) / PLAUSIBLE_RANGE_SIGMAS
                u = UnknownParameter(name, math.sqrt(low * high), spread, p.unit, p.span)
            else:
                spread = (high - low) / PLAUSIBLE_RANGE_SIGMAS
                u = UnknownParameter(name, 0.5 * (low + high), spread, p.unit, p.span, ParameterScale.LINEAR)
            out.append(limit_to_prior_bound(u))
        return out


@dataclasses.dataclass(frozen=True)
class FreeTerm(Candidate):
    """Something at a place of the machine that follows no law, linear in its free numbers; values in SI.

    Args:
        place: slot, variable and factors.
        spread: prior standard deviation of each number.
    """

    place: LawPlace = LawPlace("", "")
    spread: float = 1.0

    @property
    def text(self) -> str:
        """Where the term acts and on what it depends, in words."""
        raise NotImplementedError

    @property
    def title(self) -> str:
        """See `Candidate.title`."""
        return self.text

    def effect(self) -> Effect:
        """The term as an effect, without influence at first."""
        return self.kind()

    def mounted(self, machine: Rig, instruments: Instruments) -> tuple[Rig, Instruments]:
        """The machine with the term, without influence at first."""
        return structs.replace(machine, effects=(*machine.effects, self.effect())), instruments

    def added(self, campaign: Campaign) -> AddedTerm:
        """The term and its unknowns, for the derivatives of the signals."""
        return AddedTerm(self.effect(), self.unknowns(campaign))


def candidates_for(
    campaign: Campaign, machine: Rig, instruments: Instruments, more: Iterable[type[Effect]] = (),
    library: Iterable[type[Effect]] | None = None,
) -> list[Candidate]:  # fmt: skip
    """List the effects that a machine could have and lacks, and the sensor faults that its chains lack.

    Args:
        campaign: measurements; each of its channels can have every sensor fault.
        machine: the model, with the effects accepted so far.
        instruments: the measurement chains, with the sensor faults accepted so far.
        more: effect classes to consider beside those of the library.
        library: effect classes of the library to consider; all by default.
    """
    present, more = {effect.id for effect in machine.effects}, tuple(more)
    allowed = {kind.id for kind in (*(LIBRARY if library is None else library), *more)}
    effects = [
        Candidate(kind)
        for kind in dict.fromkeys((*(kind for kind in LIBRARY if kind.id in allowed), *more))
        if kind.id not in present and can_mount(machine, kind)
    ]
    links = {(signal, type(link)) for signal, chain in instruments.chains.items() for link in chain}
    # a dead time of half a sample is confounded with the way in which a lag is sampled
    links |= {(signal, SensorDelay) for signal, kind in links if kind is SensorLag}
    return effects + [
        Candidate(kind, signal) for signal in campaign.channels for kind in SENSOR_FAULTS if (signal, kind) not in links
    ]


def can_mount(machine: Rig, kind: type[Effect]) -> bool:
    """Whether a machine has the slots of an effect, free where they hold one effect only, and the parts it reads."""
    mounted = tuple(type(effect) for effect in machine.effects)
    if kind.id in {effect.id for effect in machine.effects}:
        return False
    if any(is_used(slot, mounted) for slot in kind.slots if slot.is_exclusive):
        return False
    return _has_parts_for(KindOfMachine(machine), kind)


@functools.cache
def _has_parts_for(of: KindOfMachine, kind: type[Effect]) -> bool:
    """Whether a machine has the slots of an effect and the signals it reads; tried on one with default parameters."""
    try:
        check_effect(kind(), of.machine)
    except EffectError:
        return False
    return set(kind.slots) <= set(of.machine.slots)


def with_candidates(known: FitProblem, candidates: Iterable[Candidate]) -> FitProblem:
    """The fit problem of a model with some candidates more: same measurements, solver error, corrected time.

    Args:
        known: the fit problem of the model without them.
        candidates: candidates to mount and fit in addition; their unknowns follow those of `known` in this order. An
            uncertain parameter of the machine that has the name of a parameter of theirs is not fitted any more.
    """
    machine, instruments, unknowns = known.machine, known.instruments, known.unknowns
    for candidate in candidates:
        machine, instruments = candidate.mounted(machine, instruments)
        taken = set() if candidate.signal is not None else {p.name for p in structs.parameters(candidate.kind)}
        unknowns = (*(u for u in unknowns if u.name not in taken), *candidate.unknowns(known.campaign))
    return dataclasses.replace(
        known, machine=machine, instruments=instruments, unknowns=unknowns,
        bench=bench_deviations(known.campaign, unknowns),
    )  # fmt: skip


def from_absence(unknown: UnknownParameter, span: tuple[float, float], fades: bool) -> UnknownParameter:
    """The size of an effect as an unknown that reaches the value without influence, zero or infinity.

    A size on a logarithmic scale cannot: it ends at the prior bound. On the scale of this one the influence is about
    linear, its prior is normal around absence, and the bound towards a strong effect stays where it was. A size whose
    span holds both signs may pass through zero.

    Args:
        unknown: the size on a logarithmic scale, limited to the prior bound.
        span: smallest and largest allowed value (SI).
        fades: whether the effect fades as the size grows.
    """
    low, high = unknown.span
    if fades:
        return dataclasses.replace(
            unknown, centre=math.inf, spread=1.0 / (CALIBRATION_BOUND * low), span=(low, span[1]),
            scale=ParameterScale.RECIPROCAL,
        )  # fmt: skip
    span = max(span[0], -high), high
    return dataclasses.replace(
        unknown, centre=0.0, spread=high / CALIBRATION_BOUND, span=span, scale=ParameterScale.LINEAR
    )  # fmt: skip


def signature_grid(unknowns: list[UnknownParameter]) -> np.ndarray:
    """Points at which signatures of a candidate are simulated, as coordinates (points, n) of its unknowns.

    The first unknown is the size of the candidate, the others its shape. The sizes are close together, because the
    resonance of a mass or stiffness hardly shows at half or twice its value. A candidate with more than three unknowns,
    such as LuGre friction, is evaluated at the centre of its priors and at points spread around it.
    """
    if len(unknowns) > MOST_ON_GRID:
        spread = spread_points(len(unknowns), SPREAD_POINTS, SPREAD_HALF_WIDTH)
        return np.concatenate([np.zeros((1, len(unknowns))), spread])
    points = {1: (np.linspace(-2.5, 2.5, 11),), 2: (np.linspace(-2.0, 2.0, 6), (-1.5, -0.5, 0.5, 1.5))}
    axes = points.get(len(unknowns), ((-0.5,), (-1.6, -1.1, -0.7, -0.3, 0.0, 0.4, 0.8, 1.3), (-1.7, -0.85, 0.0, 0.85)))
    return np.array(list(itertools.product(*axes))) if unknowns else np.zeros((1, 0))
