"""Terms with memory as candidates: where does something act that depends on the past of a signal?

A lag, an inertia, or a mass on a spring is no curve over a present value. Around a fit its influence is nearly a sum of
first-order memories of one signal,

    Σ c_k (q − z_k),   τ_k dz_k/dt = q − z_k,

with fixed times τ_k that cover what a bench can show, and free coefficients c_k.

Source: approximation of a linear response by a sum of exponentials, e.g. Oppenheim, Signals and Systems (1997), ch. 4.
"""

import functools
from collections.abc import Callable

import numpy as np

from edhas_jax.core.structs import par
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.laws.deviation import AddedTerm, added_slopes
from edhas_jax.diagnosis.laws.law_places import law_places, typical_size
from edhas_jax.diagnosis.laws.law_samples import samples_at_slots
from edhas_jax.diagnosis.search.free_term import FreeTerm, score_free_term
from edhas_jax.diagnosis.search.screening import Score, ScoreTest
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.base import state
from edhas_jax.machine.effects.tabulated_law import LawPlace
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

TIMES = (0.3e-3, 1e-3, 3e-3, 10e-3)  # s, τ_k
LIMITS = (-1e30, 1e30)  # of coefficients
# slots that add a term to an equation of motion or of the coil, and the signals whose past may matter there
PLACES = (
    ("coil_voltage_change", "voltage"), ("coil_voltage_change", "current"), ("coil_voltage_change", "piston_velocity"),
    ("mover_force", "current"), ("mover_force", "piston_velocity"), ("cylinder_force", "cylinder_velocity"),
)  # fmt: skip


class MemoryTerm(FreeTerm):
    """A term that depends on the past of a signal; its numbers are the coefficients c_k."""

    @property
    def text(self) -> str:
        """Where the term acts and on what it depends, in words."""
        return f"a term that depends on the past of {self.place.variable}, as {self.place.slot}".replace("_", " ")

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The coefficients as unknowns, with a normal prior each."""
        unit, limits = coefficient_unit(self.place), (-np.inf, np.inf)
        return [
            UnknownParameter(f"{self.prefix}coefficient_{k}", 0.0, self.spread, unit, limits, ParameterScale.LINEAR)
            for k in range(1, len(TIMES) + 1)
        ]


def coefficient_unit(place: LawPlace) -> str:
    """SI unit of the coefficients of a place."""
    return f"{place.declaration.unit}/({place.variable_unit})"


@functools.cache
def memory_class(place: LawPlace) -> type[Effect]:
    """The class of an effect that adds Σ c_k (q − z_k) to a slot, with the coefficients c_k as parameters."""
    numbers = range(1, len(TIMES) + 1)

    def contribute(self, s, z):
        q = getattr(s, place.variable)
        return sum(getattr(self, f"coefficient_{k}") * (q - getattr(z, f"memory_{k}")) for k in numbers)

    def rates(self, s, z):
        q = getattr(s, place.variable)
        return {f"memory_{k}": (q - getattr(z, f"memory_{k}")) / TIMES[k - 1] for k in numbers}

    body = {f"coefficient_{k}": par(0.0, coefficient_unit(place), LIMITS, f"c_{k}") for k in numbers}
    body |= {"__annotations__": dict.fromkeys(body, float)}
    body |= {f"memory_{k}": state(place.variable_unit, f"{place.variable} of the past") for k in numbers}
    body |= {
        "__module__": __name__,
        "__doc__": f"Memory of {place.variable} at the slot {place.slot}.\n\nSource: a sum of exponentials.",
        "id": f"memory_of_{place.variable}_at_{place.slot}",
        "looks_like": "a response to the past",
        place.slot: contribute,
        "rates": rates,
    }
    # compiled loops are cached by the name of the class
    return type("".join(part.title() for part in body["id"].split("_")), (Effect,), body)


def score_memory_terms(test: ScoreTest, fit: Fit, report: Callable[[str], None]) -> list[Score]:
    """The score tests of terms with memory at the places of a machine, the largest predicted fall of χ² first.

    Args:
        test: score test of a model.
        fit: the fit of this model.
        report: called with a sentence on the progress.
    """
    places = [LawPlace(slot, variable) for slot, variable in PLACES]
    places = [place for place in places if place in law_places(fit.machine, place.slot)]
    if not places:
        return []
    report("looking for terms that depend on the past")
    samples, terms = samples_at_slots(fit, places), []
    for place in places:
        if (past := float(np.std(samples[place.slot].values[place.variable]))) > 0.0:
            terms.append(MemoryTerm(memory_class(place), None, place, typical_size(place, past)))
    campaign = fit.problem.campaign
    found = added_slopes(fit, [AddedTerm(term.kind(), term.unknowns(campaign)) for term in terms])
    scores = []
    for term, slopes in zip(terms, found, strict=True):
        by_coefficient = [{n: v / term.spread for n, v in run.items()} for run in slopes]
        scores.append(score_free_term(test, term, by_coefficient))
    return sorted(scores, key=lambda score: -score.chi_square_fall)
