"""The posterior over sets of causes of one campaign, and what it says of each cause."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.search.answer import NOTHING, UNKNOWN
from edhas_jax.diagnosis.search.calibrated_model import calibrate
from edhas_jax.diagnosis.search.candidates import Candidate, candidates_for
from edhas_jax.diagnosis.search.free_term import FreeTerm
from edhas_jax.diagnosis.search.holdout_split import split_for_holdout
from edhas_jax.diagnosis.search.outcome import MUCH_LEFT
from edhas_jax.diagnosis.sets.set_search import FittedSet, SetSearch
from edhas_jax.diagnosis.sets.signature_table import signature_table
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign

COVERAGE = 0.95  # probability that a member of the set of names is right


@dataclasses.dataclass(frozen=True)
class SetPosterior:
    """Sets of causes with their probabilities.

    Args:
        sets: the fitted sets, the most probable first.
    """

    sets: tuple[FittedSet, ...]

    @functools.cached_property
    def weights(self) -> tuple[float, ...]:
        """The probability of each set."""
        largest = self.sets[0].log_weight
        weights = [math.exp(of.log_weight - largest) for of in self.sets]
        return tuple(weight / sum(weights) for weight in weights)

    @functools.cached_property
    def probabilities(self) -> dict[str, float]:
        """The probability of each name to be in the set, of an unknown cause, and of nothing; the largest first."""
        found: dict[str, float] = {NOTHING: 0.0, UNKNOWN: 0.0}
        for of, weight in zip(self.sets, self.weights, strict=True):
            for name in labels(of):
                found[name] = found.get(name, 0.0) + weight
        return dict(sorted(found.items(), key=lambda item: -item[1]))

    @functools.cached_property
    def members(self) -> tuple[tuple[Candidate, float], ...]:
        """The members of the most probable set, each with its fall of the misfit [nats], the largest first."""
        fitted, best = {of.key: of for of in self.sets}, self.sets[0]
        without = {c: fitted.get(best.key - {c.name}) for c in best.members}
        falls = {c: math.inf if of is None else of.misfit - best.misfit for c, of in without.items()}
        return tuple(sorted(falls.items(), key=lambda item: -item[1]))

    @functools.cached_property
    def credible(self) -> tuple[str, ...]:
        """The fewest names of which one at least is right with a probability of `COVERAGE`; taken one by one."""
        left, chosen = list(zip(map(labels, self.sets), self.weights, strict=True)), []
        while sum(weight for _, weight in left) > 1.0 - COVERAGE:
            gains: dict[str, float] = {}
            for names, weight in left:
                for name in names:
                    gains[name] = gains.get(name, 0.0) + weight
            chosen.append(max(gains, key=gains.__getitem__))
            left = [(names, weight) for names, weight in left if chosen[-1] not in names]
        return tuple(chosen)


def labels(of: FittedSet) -> tuple[str, ...]:
    """The names of the effects and faults of a set, and `UNKNOWN` for a free term.

    `NOTHING` for the empty set; `UNKNOWN` where that leaves more than `MUCH_LEFT` times the noise.
    """
    leaves_much = of.excess > 0.5 * (MUCH_LEFT**2 - 1.0) * of.samples
    of_empty = UNKNOWN if leaves_much else NOTHING
    return tuple(UNKNOWN if isinstance(c, FreeTerm) else c.name for c in of.members) or (of_empty,)


@single_threaded_algebra
def posterior_over_sets(
    campaign: Campaign, library: Iterable[type[Effect]] | None = None, more: Iterable[type[Effect]] = (),
    on_progress: Callable[[str], None] | None = None,
) -> SetPosterior:  # fmt: skip
    """Calibrate the model of a campaign and search for the sets of effects and sensor faults that it may lack.

    Args:
        campaign: measurements, model, prior of the uncertain parameters, and noise of the sensors.
        library: effect classes to consider, all of the library by default; sensor faults are always considered.
        more: effect classes of the user's own.
        on_progress: called with a sentence on the progress.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    report = on_progress or (lambda sentence: None)
    campaign, _ = split_for_holdout(checked_campaign(campaign))
    calibrated, resolution = calibrate(campaign, report)
    fitted = calibrated.fit.problem
    candidates = candidates_for(campaign, fitted.machine, fitted.instruments, more, library)
    table = signature_table(calibrated.fit, candidates, report)
    return SetPosterior(tuple(SetSearch(calibrated, table, resolution, report).run()))
