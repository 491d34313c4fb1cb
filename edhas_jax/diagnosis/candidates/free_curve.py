"""Free curves as candidates: where does something act of which no law is known?

At every place of the machine (a slot, and a variable that a law there may follow) a curve of unknown shape may be
added: a sum of smooth shapes (`smooth_shapes`), whose coefficients a fit estimates with all other unknowns.
Around a fit the signals are linear in them, so that one simulation with derivatives tells how much of the misfit the
best curve explains.
"""

import dataclasses
import math
from collections.abc import Callable, Iterator

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import FreeTerm
from edhas_jax.diagnosis.laws.added_terms import Columns, added_slopes
from edhas_jax.diagnosis.laws.curve_prior import smooth_shapes
from edhas_jax.diagnosis.laws.curve_start import start_from_nothing
from edhas_jax.diagnosis.laws.law_curve import LawCurve
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import LawSamples, law_samples, samples_at_slots
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace, LawTable, tabulated_class
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.unknown_parameters import ShapeCoefficient, UnknownParameter

PREDICTED = 6  # of the shapes, the smoothest, whose signatures are simulated; the others have 3 % of the variance
GROUP = 4  # curves that are simulated together: more save compilation, fewer the time of each step


@dataclasses.dataclass(frozen=True)
class CurveCandidate(FreeTerm):
    """A curve at a place of the machine; values in SI. Its numbers are the coefficients of its shapes.

    Args:
        nodes: nodes of the curve.
    """

    nodes: tuple[float, ...] = ()

    @property
    def text(self) -> str:
        """Where the curve acts and over what, in words."""
        over = " · ".join(["a curve over " + self.place.variable, *self.place.factors])
        return f"{over} as {self.place.slot}".replace("_", " ")

    def effect(self) -> Effect:
        """See `FreeTerm.effect`."""
        nodes = np.array(self.nodes)
        return LawTable(self.id, self.place, nodes, np.full(len(nodes), self.place.neutral)).effect()

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The coefficients of the shapes as unknowns, with a standard normal prior each."""
        names = [f"{self.id}.value_{k}" for k in range(1, len(self.nodes) + 1)]
        return [
            ShapeCoefficient.of(own, dict(zip(names, map(float, column), strict=True)))
            for own, column in zip(self.coefficient_names, self.spread * self.shapes.T, strict=True)
        ]

    @property
    def shapes(self) -> np.ndarray:
        """The shapes (n, n) at the nodes."""
        return smooth_shapes(np.array(self.nodes))

    @property
    def coefficient_names(self) -> list[str]:
        """The names of the coefficients among the unknowns of a fit."""
        return [f"{self.prefix}shape_{k}" for k in range(1, len(self.nodes) + 1)]

    def nearest(self, values: np.ndarray) -> np.ndarray:
        """The coefficients (k,) of the curve that comes nearest to values at the nodes (n,), in prior deviations."""
        return np.linalg.lstsq(self.shapes, values, rcond=None)[0]

    def table(self, fit: Fit, origin: str = "") -> LawTable:
        """The curve as fitted, with its standard errors.

        Args:
            fit: a fit with the curve.
            origin: where it comes from, for a file.
        """
        places = [k for k, u in enumerate(fit.problem.unknowns) if u.name in self.coefficient_names]
        shapes, covariance = self.spread * self.shapes, fit.covariance[np.ix_(places, places)]
        values = self.place.neutral + shapes @ fit.x[places]
        errors = np.sqrt(np.einsum("nk,kl,nl->n", shapes, covariance, shapes))
        return LawTable(self.id, self.place, np.array(self.nodes), values, errors, origin)


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
    """The free curves at all places, each with the derivatives of all signals by its first `PREDICTED` coefficients.

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
        terms = [curve.added(fit.problem.campaign) for curve in some]
        slopes = added_slopes(fit, [term._replace(unknowns=term.unknowns[:PREDICTED]) for term in terms])
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
