"""Terms with memory as candidates: where does something act that depends on the past of a signal?

A lag, an inertia, or a mass on a spring is no curve over a present value. Around a fit its influence is nearly a sum of
first-order memories of one signal,

    Σ c_k (q − z_k),   τ_k dz_k/dt = q − z_k,

with fixed times τ_k that cover what a bench can show, and free coefficients c_k; or of second-order ones, damped
oscillators that the signal excites,

    Σ a_k (q − w_k) − b_k dw_k/dt / ω_k,   d²w_k/dt² = ω_k² (q − w_k) − 2 ζ ω_k dw_k/dt.

Neighbours are so near to each other that they represent a resonance between them.

Source: approximation of a linear response by a sum of exponentials, e.g. Oppenheim, Signals and Systems (1997), ch. 4.
"""

import functools
import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from edhas_jax.core import structs
from edhas_jax.core.structs import par
from edhas_jax.diagnosis.candidates.candidate import FreeTerm
from edhas_jax.diagnosis.laws.added_terms import Columns, added_slopes
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import samples_at_slots
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.base import state
from edhas_jax.machine.effects.tabulated_law import LawPlace
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.unknown_parameters import ParameterScale, UnknownParameter

TIMES = (0.3e-3, 1e-3, 3e-3, 10e-3)  # s, τ_k
FREQUENCIES, DAMPING = (40.0, 60.0, 90.0, 135.0, 200.0, 300.0), 0.15  # Hz, ω_k/2π, and ζ
LIMITS = (-1e30, 1e30)  # of coefficients
# slots that add a term to an equation of motion or of the coil, and the signals whose past may matter there
PLACES = (
    ("coil_voltage_change", "voltage"), ("coil_voltage_change", "current"), ("coil_voltage_change", "piston_velocity"),
    ("mover_force", "current"), ("mover_force", "piston_velocity"), ("cylinder_force", "cylinder_velocity"),
)  # fmt: skip
# the same of oscillators: what is excited by the force of the coil, or moves with a mass
OSCILLATOR_PLACES = (
    ("mover_force", "current"), ("mover_force", "piston_velocity"), ("cylinder_force", "cylinder_velocity"),
)  # fmt: skip


class MemoryTerm(FreeTerm):
    """A term that depends on the past of a signal; its numbers are the coefficients."""

    @property
    def text(self) -> str:
        """Where the term acts and on what it depends, in words."""
        return f"a term that depends on the past of {self.place.variable}, as {self.place.slot}".replace("_", " ")

    def unknowns(self, campaign: Campaign) -> list[UnknownParameter]:
        """The coefficients as unknowns, with a normal prior each."""
        unit, limits = coefficient_unit(self.place), (-np.inf, np.inf)
        return [
            UnknownParameter(f"{self.prefix}coefficient_{k}", 0.0, self.spread, unit, limits, ParameterScale.LINEAR)
            for k in range(1, len(structs.parameters(self.kind)) + 1)
        ]


class OscillatorTerm(MemoryTerm):
    """A term of damped oscillators that a signal excites; its numbers are the coefficients."""

    @property
    def text(self) -> str:
        """Where the term acts and what excites it, in words."""
        return f"a resonance that {self.place.variable} excites, as {self.place.slot}".replace("_", " ")


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

    states = {f"memory_{k}": state(place.variable_unit, f"{place.variable} of the past") for k in numbers}
    name = f"memory_of_{place.variable}_at_{place.slot}"
    return _term_class(memory_class, name, place, len(TIMES), contribute, rates, states)


@functools.cache
def oscillator_class(place: LawPlace) -> type[Effect]:
    """The class of an effect that adds oscillators to a slot, with a_1, b_1, a_2, b_2 … as parameters."""
    numbers, unit = range(1, len(FREQUENCIES) + 1), place.variable_unit

    def contribute(self, s, z):
        q = getattr(s, place.variable)
        parts = []
        for k, frequency in enumerate(FREQUENCIES, start=1):
            speed = getattr(z, f"speed_{k}") / (2.0 * math.pi * frequency)
            parts += [getattr(self, f"coefficient_{2 * k - 1}") * (q - getattr(z, f"follower_{k}"))]
            parts += [-getattr(self, f"coefficient_{2 * k}") * speed]
        return sum(parts)

    def rates(self, s, z):
        q, out = getattr(s, place.variable), {}
        for k, frequency in enumerate(FREQUENCIES, start=1):
            omega, speed = 2.0 * math.pi * frequency, getattr(z, f"speed_{k}")
            out[f"follower_{k}"] = speed
            out[f"speed_{k}"] = omega * omega * (q - getattr(z, f"follower_{k}")) - 2.0 * DAMPING * omega * speed
        return out

    states = {f"follower_{k}": state(unit, f"{place.variable} as an oscillator follows it") for k in numbers}
    states |= {f"speed_{k}": state(f"{unit}/s", "its rate") for k in numbers}
    name = f"resonance_with_{place.variable}_at_{place.slot}"
    return _term_class(oscillator_class, name, place, 2 * len(FREQUENCIES), contribute, rates, states)


def _term_class(
    generated_by: Callable, name: str, place: LawPlace, count: int, contribute: Callable, rates: Callable,
    states: Mapping[str, Any],
) -> type[Effect]:  # fmt: skip
    """An effect class with coefficients as parameters, as the function `generated_by` makes it for a place."""
    body: dict[str, Any] = {
        f"coefficient_{k}": par(0.0, coefficient_unit(place), LIMITS, f"of part {k}") for k in range(1, count + 1)
    }
    body |= {"__annotations__": dict.fromkeys(body, float)} | dict(states)
    body |= {
        "__module__": __name__,
        "__doc__": f"Memory of {place.variable} at the slot {place.slot}.\n\nSource: a sum of exponentials.",
        "id": name,
        "looks_like": "a response to the past",
        "_generated_by": (generated_by, (place,)),
        place.slot: contribute,
        "rates": rates,
    }
    # compiled loops are cached by the name of the class
    return type("".join(part.title() for part in name.split("_")), (Effect,), body)


def memories_with_slopes(fit: Fit, report: Callable[[str], None]) -> list[tuple[MemoryTerm, Columns]]:
    """The terms with memory at the places of a machine, each with the derivatives of all signals by its coefficients.

    Args:
        fit: the fit of the model to which they are added.
        report: called with a sentence on the progress.
    """
    kinds = [(MemoryTerm, memory_class, slot, variable) for slot, variable in PLACES]
    kinds += [(OscillatorTerm, oscillator_class, slot, variable) for slot, variable in OSCILLATOR_PLACES]
    kinds = [(*kind, LawPlace(slot, variable)) for *kind, slot, variable in kinds]
    kinds = [(*kind, place) for *kind, place in kinds if place in law_places(fit.machine, place.slot)]
    if not kinds:
        return []
    report("looking for terms that depend on the past")
    samples, terms = samples_at_slots(fit, [place for *_, place in kinds]), []
    for term, class_at, place in kinds:
        if (past := float(np.std(samples[place.slot].values[place.variable]))) > 0.0:
            terms.append(term(class_at(place), None, place, place.declaration.typical_size / past))
    found = added_slopes(fit, [term.added(fit.problem.campaign) for term in terms])
    return list(zip(terms, found, strict=True))
