"""Deviation of an accepted law from that of the library: what the same mechanism explains with another law.

An effect of a bench seldom follows the law of the library to the letter. The difference acts at the same slot, over the
variable that the law follows. A curve over this variable is therefore added, with a prior of a share of the law's own
magnitude at each of its nodes. Whatever it reproduces is no reason to add another effect.

A law with memory, such as the lag of an amplifier, may remember in another way: memories of the same signal are added
in place of the curve, see `memory_term`.

Around a fit the curve is linear in its values, so that columns of its slopes tell what it would explain. Where that is
clear the curve is mounted on the machine, and its values become unknowns of the fit as any other parameter.
"""

from collections.abc import Sequence

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate
from edhas_jax.diagnosis.candidates.free_curve import CurveCandidate
from edhas_jax.diagnosis.candidates.memory_term import MemoryTerm, memory_class
from edhas_jax.diagnosis.laws.added_terms import Columns, added_slopes
from edhas_jax.diagnosis.laws.curve_basis import basis, free_nodes
from edhas_jax.diagnosis.laws.curve_start import start_beside_law
from edhas_jax.diagnosis.laws.law_places import law_places
from edhas_jax.diagnosis.laws.law_samples import law_samples, samples_at_slots
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.tabulated_law import LawPlace, tabulated_class

DEVIATION_SHARE = 0.5  # prior standard deviation of the deviation, over the largest magnitude of the law
# a law that changes that fast, in shares of the range of its variable, as a friction around standstill does, gets so
# many nodes for its deviation, clustered that much around zero
STEEP_SPACING, STEEP_NODES, STEEP_CLUSTERING = 0.02, 13, 6.0
MIN_VARIATION = 1e-3  # standard deviation of a law over its largest magnitude, below which it is constant
SUFFIX = "_deviation"  # of the name of an effect: the id of the deviation of its law


class LawDeviation(CurveCandidate):
    """The deviation of the law of an effect from that of the library as a curve that is added at the same place."""

    @property
    def of(self) -> str:
        """The id of the effect whose law deviates."""
        return self.id.removesuffix(SUFFIX)


def deviation_of(candidate: Candidate, laws: Sequence[LawDeviation]) -> LawDeviation | None:
    """The one of some deviations that belongs to the law of a candidate; None for a sensor fault, and without one."""
    return None if candidate.signal is not None else next((law for law in laws if law.of == candidate.id), None)


def law_deviation(fit: Fit, candidate: Candidate) -> LawDeviation | None:
    """The deviation that the law of a candidate may have, over the variable that explains most of this law.

    Args:
        fit: a fit that contains the candidate.
        candidate: the candidate; a sensor fault has no law that could deviate.

    Returns:
        The deviation; None where the law vanishes, has a memory (see `memory_columns`), or its slot has no variable.
    """
    if candidate.signal is not None or isinstance(candidate, LawDeviation) or candidate.memory_of:
        return None
    effect = _effect_of(fit, candidate)
    start = start_beside_law(fit, effect)
    if start is None:
        return None
    is_constant = np.std(start.law) <= MIN_VARIATION * start.size
    if is_constant and not effect.varies_with and len(law_places(fit.machine, start.place.slot)) > 1:
        return None
    low, high = float(start.nodes[0]), float(start.nodes[-1])
    is_steep = np.diff(start.nodes).min() < STEEP_SPACING * (high - low)
    nodes = free_nodes(low, high, STEEP_NODES, STEEP_CLUSTERING) if is_steep else free_nodes(low, high)
    kind = tabulated_class(candidate.id + SUFFIX, start.place, len(nodes))
    return LawDeviation(kind, None, start.place, DEVIATION_SHARE * start.size, tuple(map(float, nodes)))


def law_at_nodes(fit: Fit, candidate: Candidate, curve: CurveCandidate) -> tuple[np.ndarray, float] | None:
    """The law of a candidate at the nodes of a free curve (n,), and its largest magnitude, SI.

    Args:
        fit: a fit that contains the candidate.
        candidate: the candidate.
        curve: the curve, of another fit.

    Returns:
        None where the law is no function of the variable of the curve alone, or acts elsewhere.
    """
    start = None if candidate.signal is not None else start_beside_law(fit, _effect_of(fit, candidate))
    place = curve.place
    if start is None or not start.replaces or start.place[1:3] != place[1:3]:
        return None
    if start.place.slot != place.slot and start.place.declaration.same_as != place.declaration.same_as:
        return None
    return basis(np.asarray(start.nodes), np.array(curve.nodes)) @ start.law_values, start.size


def law_size(fit: Fit, candidate: Candidate, place: LawPlace) -> float | None:
    """The magnitude of the law of a candidate as that of a curve at a place, SI.

    Args:
        fit: a fit that contains the candidate.
        candidate: the candidate.
        place: the place.

    Returns:
        None where the law acts elsewhere, or is a function of another variable alone.
    """
    if candidate.signal is not None:
        return None
    term = place.declaration.same_as or place.slot
    slot = next((slot for slot in candidate.kind.slots if (slot.same_as or slot.name) == term), None)
    own = () if slot is None else law_places(fit.machine, slot.name)
    start = start_beside_law(fit, _effect_of(fit, candidate)) if own else None
    if not own or start is not None and start.replaces and start.place[1:3] != place[1:3]:
        return None
    samples = samples_at_slots(fit, (own[0], place), candidate.id)
    law, weight = samples[own[0].slot].law - own[0].neutral, samples[place.slot].weight(place)
    size = float(np.abs(law).max() / np.sqrt(np.mean(np.square(weight))))
    return size if size > 0.0 and np.isfinite(size) else None


def law_deviation_columns(fit: Fit, accepted: Sequence[Candidate]) -> list[dict[str, np.ndarray]]:
    """The change of the signals by a deviation of each accepted law, by fitted run and signal (samples, k) in SI.

    Args:
        fit: a fit that contains the accepted candidates.
        accepted: these candidates; those whose deviation is mounted already have no columns.
    """
    runs, free = fit.problem.model().runs, {c.of for c in accepted if isinstance(c, LawDeviation)}
    found = [law_deviation(fit, candidate) for candidate in accepted if candidate.id not in free]
    parts = [curve_columns(fit, d) for d in found if d is not None]
    parts += [memory_columns(fit, candidate) for candidate in accepted]
    parts = [columns for columns in parts if columns is not None]
    return [
        {
            n: np.concatenate([np.zeros((len(run.time), 0)), *(part[r][n] for part in parts)], axis=1)
            for n in run.signals
        }
        for r, run in enumerate(runs)
    ]


def curve_columns(fit: Fit, deviation: LawDeviation) -> Columns | None:
    """The change of the signals by one prior standard deviation of each shape; None where that is not finite."""
    return _finite(*added_slopes(fit, [deviation.added(fit.problem.campaign)]))


def memory_columns(fit: Fit, candidate: Candidate) -> Columns | None:
    """The change of the signals where a law that depends on the past of a signal does so in another way.

    Args:
        fit: a fit that contains the candidate.
        candidate: the candidate.

    Returns:
        By fitted run and signal (samples, k) in SI; None for a law without memory, where it is not finite, and where
        the fit has these memories already.
    """
    if candidate.signal is not None or not candidate.memory_of:
        return None
    place = LawPlace(candidate.kind.slots[0].name, candidate.memory_of)
    is_mounted = any(effect.id == memory_class(place).id for effect in fit.machine.effects)
    if is_mounted or place not in law_places(fit.machine, place.slot):
        return None
    samples = law_samples(fit, (place,), candidate.id)
    past, size = np.std(samples.values[place.variable]), np.abs(samples.law).max()
    if not (past > 0.0 and size > 0.0 and np.isfinite(size)):
        return None
    term = MemoryTerm(memory_class(place), None, place, DEVIATION_SHARE * float(size / past))
    return _finite(*added_slopes(fit, [term.added(fit.problem.campaign)]))


def _finite(columns: Columns) -> Columns | None:
    return columns if all(np.isfinite(v).all() for run in columns for v in run.values()) else None


def _effect_of(fit: Fit, candidate: Candidate) -> Effect:
    return next(effect for effect in fit.machine.effects if effect.id == candidate.id)
