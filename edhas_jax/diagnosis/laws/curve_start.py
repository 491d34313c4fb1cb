"""Where the estimate of a curve starts: variable, nodes, and the library's law or nothing as first guess."""

import dataclasses

import numpy as np

from edhas_jax.diagnosis.laws.curve_basis import basis, explained_share, fit_values, free_nodes, law_nodes
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import LawSamples, law_samples
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace

SAMPLES = 4000  # approximate number of samples from which a law is taken
VARIABLE_TIE = 0.01  # difference in explained share below which the place listed first is taken
REPLACING_SHARE = 0.98  # of a law that a curve over one variable has to explain in order to take its place


@dataclasses.dataclass(frozen=True)
class CurveStart:
    """A curve before its estimation; all values in SI.

    Args:
        place: slot, variable and factors.
        replaces: whether the curve takes the place of the law; else it is added to it.
        nodes: nodes (n,).
        centre: first guess (n,) of the values, and mean of their prior.
        size: typical magnitude of the law in the unit of the values.
        law_values: the library's law at the nodes (n,); None without a law.
        x: variable (m,) along the fitted runs.
        weight: product (m,) of the factors there.
        law: contribution (m,) of the law there; None without a law.
    """

    place: LawPlace
    replaces: bool
    nodes: np.ndarray
    centre: np.ndarray
    size: float
    law_values: np.ndarray | None
    x: np.ndarray
    weight: np.ndarray
    law: np.ndarray | None


def start_beside_law(fit: Fit, effect: Effect) -> CurveStart | None:
    """The start of a curve for the law of an effect, over the variable that explains most of this law.

    A law that is constant is drawn over the signal with which it would vary, if the effect names one.

    Args:
        fit: a fit whose machine has the effect.
        effect: the effect.

    Returns:
        The start; None where the law vanishes or is not finite, or its slot has no variable.
    """
    # the first slot where a curve has a meaning: entrained air, for one, also sets a pole that none can follow
    places = next((found for slot in effect.slots if (found := law_places(fit.machine, slot.name))), ())
    places = tuple(place for place in places if effect.varies_with in ("", place.variable))
    if not places:
        return None
    samples = _thinned(law_samples(fit, places, effect.id))
    found = {place: _represent(place, samples) for place in places if _is_usable(place, samples)}
    if not found or not np.isfinite(samples.law).all():
        return None
    best = max(share for _, _, share in found.values())
    place = next(place for place, (_, _, share) in found.items() if share > best - VARIABLE_TIE)
    nodes, values, share = found[place]
    size = float(np.abs(values).max())
    if not size > 0.0:
        return None
    replaces = share > REPLACING_SHARE and len(effect.slots) == 1 and not effect.states
    values = values + place.neutral
    centre = values if replaces else np.full(len(nodes), place.neutral)
    x, weight = samples.values[place.variable], samples.weight(place)
    return CurveStart(place, replaces, nodes, centre, size, values, x, weight, samples.law)


def with_law_of(start: CurveStart, other: CurveStart | None) -> CurveStart:
    """A start with the library's law of another fit, where that one is over the same variable; else unchanged."""
    if other is None or other.place != start.place:
        return start
    values = basis(other.nodes, start.nodes) @ other.law_values
    return dataclasses.replace(start, law_values=values, centre=values if start.replaces else start.centre)


def start_from_nothing(
    fit: Fit, place: LawPlace, nodes: np.ndarray | None = None, samples: LawSamples | None = None
) -> CurveStart | None:  # fmt: skip
    """The start of a curve at a place, with no influence at first.

    Args:
        fit: the fit.
        place: where the curve is added.
        nodes: nodes (n,) in SI; by default eleven over the range of the variable.
        samples: samples along the fitted runs at the slot of the place; simulated by default.

    Returns:
        The start; None where the variable is constant.
    """
    samples = _thinned(samples or law_samples(fit, (place,)))
    if not _is_usable(place, samples):
        return None
    x, weight = samples.values[place.variable], samples.weight(place)
    nodes = free_nodes(float(x.min()), float(x.max())) if nodes is None else np.asarray(nodes, float)
    size = place.declaration.typical_size / float(np.sqrt(np.mean(np.square(weight))))
    return CurveStart(place, True, nodes, np.full(len(nodes), place.neutral), size, None, x, weight, None)


def _thinned(samples: LawSamples) -> LawSamples:
    """About `SAMPLES` of the samples, evenly distributed."""
    count = len(next(iter(samples.values.values())))
    kept = slice(None, None, max(1, count // SAMPLES))
    law = None if samples.law is None else samples.law[kept]
    return LawSamples({name: values[kept] for name, values in samples.values.items()}, law)


def _is_usable(place: LawPlace, samples: LawSamples) -> bool:
    """Whether variable and factors of a place are finite and vary."""
    x, weight = samples.values[place.variable], samples.weight(place)
    return bool(np.isfinite(x).all() and np.isfinite(weight).all() and np.ptp(x) > 0.0 and np.abs(weight).max() > 0.0)


def _represent(place: LawPlace, samples: LawSamples) -> tuple[np.ndarray, np.ndarray, float]:
    """Nodes and values of the curve nearest to a law, as a deviation from no influence, and the share it explains."""
    x, weight, y = samples.values[place.variable], samples.weight(place), samples.law - place.neutral
    nodes = law_nodes(x, y, weight)
    values = fit_values(nodes, x, y, weight)
    return nodes, values, explained_share(nodes, values, x, y, weight)
