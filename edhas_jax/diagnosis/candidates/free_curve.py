"""Free curves as candidates: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape may be
added. Its values at the nodes are parameters that a fit estimates with all others. Around a fit the signals are linear
in them, so that one simulation with derivatives tells how much of the misfit the best curve explains.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np

from edhas_jax.core import structs
from edhas_jax.diagnosis.candidates.candidate import FreeTerm
from edhas_jax.diagnosis.laws.added_terms import Columns, added_slopes, curve_term
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import LawSamples, law_samples, samples_at_slots
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable, tabulated_class
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

GROUP = 4  # curves that are simulated together: more save compilation, fewer the time of each step


@dataclasses.dataclass(frozen=True)
class CurveCandidate(FreeTerm):
    """A curve at a place of the machine; values in SI.

    Args:
        nodes: nodes of the curve, whose values at them are its numbers.
    """

    nodes: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """Where the curve acts and over what, in words."""
        over = " · ".join(["a curve over " + self.place.variable, *self.place.factors])
        return f"{over} as {self.place.slot}".replace("_", " ")

    def mounted(self, machine: Rig, instruments: Instruments) -> tuple[Rig, Instruments]:
        """The machine with the curve, without influence at first."""
        nodes = np.array(self.nodes)
        effect = LawTable(self.id, self.place, nodes, np.full(len(nodes), self.place.neutral)).effect()
        return structs.replace(machine, effects=(*machine.effects, effect)), instruments

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The values of the curve as unknowns, with a normal prior each."""
        neutral, unit, limits = self.place.neutral, self.place.value_unit, (-np.inf, np.inf)
        return [
            UnknownParameter(name, neutral, self.spread, unit, limits, ParameterScale.LINEAR)
            for name in self.value_names
        ]

    @property
    def value_names(self) -> list[str]:
        """The names of the values among the unknowns of a fit."""
        return [f"{self.prefix}value_{k}" for k in range(1, len(self.nodes) + 1)]

    def table(self, fit: Fit, origin: str = "") -> LawTable:
        """The curve as fitted, with its standard errors.

        Args:
            fit: a fit with the curve.
            origin: where it comes from, for a file.
        """
        all_errors = {u.name: u.spread * std for u, std in zip(fit.problem.unknowns, fit.std, strict=True)}
        values, errors = ([of[name] for name in self.value_names] for of in (fit.values, all_errors))
        return LawTable(self.id, self.place, np.array(self.nodes), np.array(values), np.array(errors), origin)


def fitted_curve(fit: Fit, curve: CurveCandidate) -> LawCurve:
    """A free curve as fitted, for a figure, with the values that its variable took along the runs."""
    table, samples = curve.table(fit), law_samples(fit, (curve.place,))
    return LawCurve(
        curve.id, curve.place, "", table.nodes, table.values, table.std, None, table.values, None, math.nan,
        samples.values[curve.place.variable], None,
    )  # fmt: skip


def free_curve(fit: Fit, place: LawPlace, samples: LawSamples | None = None) -> CurveCandidate | None:
    """A free curve over the values that its variable takes along the fitted runs; None where it is constant.

    Args:
        fit: the fit.
        place: where the curve is added.
        samples: samples along the fitted runs at the slot of the place; simulated by default.
    """
    start = start_from_nothing(fit, place, samples=samples)
    if start is None:
        return None
    kind = tabulated_class(_id_at(place), place, len(start.nodes))
    return CurveCandidate(kind, None, place, start.size, tuple(map(float, start.nodes)))


def curves_with_slopes(fit: Fit, report: Callable[[str], None]) -> Iterator[tuple[CurveCandidate, Columns]]:
    """The free curves at all places of a machine, each with the derivatives of all signals by its values.

    Args:
        fit: the fit of the model to which they are added.
        report: called with a sentence on the progress.
    """
    report("looking where curves act")
    places = _distinct_places(fit.machine)
    samples = samples_at_slots(fit, places)
    curves = [curve for place in places if (curve := free_curve(fit, place, samples[place.slot])) is not None]
    for first in range(0, len(curves), GROUP):
        some = curves[first : first + GROUP]
        report(f"looking for free curves, {first + len(some)} of {len(curves)}")
        slopes = added_slopes(fit, [curve_term(curve.place, np.array(curve.nodes), curve.id) for curve in some])
        yield from zip(some, slopes, strict=True)


def _id_at(place: LawPlace) -> str:
    """The id of the free curve at a place."""
    return "_".join((place.slot, "curve_over", place.variable, *place.factors))


def _distinct_places(machine: Rig) -> list[LawPlace]:
    """The places of a machine, without those that have a curve or where a curve is the same term as at another one."""
    found: dict[tuple, LawPlace] = {}
    present = {effect.id for effect in machine.effects}
    for slot in machine.slots:
        for place in (p for p in law_places(machine, slot.name) if _id_at(p) not in present):
            found.setdefault((slot.same_as or slot.name, place.variable, place.factors), place)
    return list(found.values())
