"""The result of a diagnosis: sets of causes with their probabilities, the model with the best one, and the verdict."""

import dataclasses
import enum
import functools
import math

import numpy as np

from edhas_jax.diagnosis.candidates.candidate import Candidate, FreeTerm
from edhas_jax.diagnosis.candidates.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.member_laws import MemberLaw
from edhas_jax.diagnosis.search.posterior import NOTHING, UNKNOWN, SetPosterior, labels
from edhas_jax.diagnosis.search.set_search import FittedSet
from edhas_jax.diagnosis.search.weight import Weighing
from edhas_jax.inference.fit.calibrated_model import misfit_beyond_noise
from edhas_jax.inference.fit.confounding import AssumedParameter
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import rms_by_signal


class Verdict(enum.Enum):
    """The conclusion of a diagnosis."""

    ADEQUATE = "adequate"
    MISSING_EFFECT = "missing_effect"
    AMBIGUOUS = "ambiguous"
    UNKNOWN_EFFECT = "unknown_effect"


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of the search for effects that a model lacks.

    Args:
        campaign: the measurements.
        posterior: the fitted sets of causes with their probabilities.
        weighing: what weighs the sets of effects.
        before: (measured − model)/noise by run and signal, of the model as it was given.
        by_library_laws: the model with the best set, everything fitted, all laws those of the library.
        after: the same with a curve beside each law that differs.
        laws: what the measurements say of the laws of the effects of the best set.
        seconds: computing time [s].
        holdout_split: a sentence on how runs were divided for want of hold-out runs; empty where there are such runs.
        assumed: parameters taken as known whose error the unknowns of the final model would hide.
    """

    campaign: Campaign
    posterior: SetPosterior
    weighing: Weighing
    before: dict[str, dict[str, np.ndarray]]
    by_library_laws: EvaluatedFit
    after: EvaluatedFit
    laws: tuple[MemberLaw, ...]
    seconds: float
    holdout_split: str = ""
    assumed: tuple[AssumedParameter, ...] = ()

    @property
    def final(self) -> Fit:
        """The fit of the final model."""
        return self.after.fit

    @functools.cached_property
    def calibrated(self) -> EvaluatedFit:
        """The model without any cause, its uncertain parameters fitted."""
        return next(of for of in self.posterior.sets if not of.members).evaluated

    @functools.cached_property
    def named(self) -> tuple[Candidate, ...]:
        """The effects and sensor faults of the best set, that which explains most first."""
        return tuple(c for c, _ in self.posterior.members if not isinstance(c, FreeTerm))

    @property
    def free_term(self) -> FreeTerm | None:
        """The free term of the best set, for what no effect of the library explains; None where it has none."""
        return next((c for c in self.posterior.best.members if isinstance(c, FreeTerm)), None)

    @property
    def curves(self) -> list[LawDeviation]:
        """The curves that the final model has beside laws that differ."""
        return [law.curve for law in self.laws if law.curve is not None]

    @property
    def first(self) -> str:
        """The answer in one word: of the best set the name that explains most, `UNKNOWN` or `NOTHING`."""
        leading = next((c for c, _ in self.posterior.members), None)
        if leading is None:
            return labels(self.posterior.best)[0]
        return UNKNOWN if isinstance(leading, FreeTerm) else leading.name

    @functools.cached_property
    def verdict(self) -> Verdict:
        """The conclusion, from the best set."""
        if self.first == NOTHING:
            return Verdict.ADEQUATE
        if self.first == UNKNOWN:
            return Verdict.UNKNOWN_EFFECT
        return Verdict.AMBIGUOUS if self.confounded_groups() else Verdict.MISSING_EFFECT

    def confounded_groups(self) -> list[list[Candidate]]:
        """The groups of candidates that these measurements do not distinguish, one of the best set first."""
        groups = [[c, *self.posterior.alternatives(c)] for c in self.named]
        return [group for group in groups if len(group) > 1]

    def model_with(self, candidate: Candidate) -> EvaluatedFit:
        """The final model if it has a candidate, else that of the most probable set that has it."""
        return self.after if candidate in self.named else self.posterior.best_with(candidate).evaluated

    def fit_of_parameters(self, candidate: Candidate) -> Fit:
        """The fit from which the stated parameters of a candidate are taken: by the laws of the library.

        Where the final model has a curve beside a law, the measurements determine the sum of the two, but hardly how it
        is divided between them.
        """
        if candidate in self.named:
            return self.by_library_laws.fit
        return self.posterior.best_with(candidate).evaluated.fit

    def growth(self) -> list[FittedSet]:
        """Fitted subsets of the best set, each with one more member than the one before, from nothing to itself."""
        chain = [self.posterior.best]
        while chain[0].members:
            smaller = [of for of in self.posterior.sets if len(of.key) + 1 == len(chain[0].key)]
            step = next((of for of in smaller if of.key < chain[0].key), None)
            if step is None:
                break
            chain.insert(0, step)
        return chain

    @functools.cached_property
    def left(self) -> float:
        """What the final model leaves of ½χ² beyond the scatter of noise [nats]."""
        return misfit_beyond_noise(self.after)

    def unexplained_shares(self) -> dict[str, float]:
        """What the final model leaves of each signal beyond the noise, over the rms of the signal, on new runs.

        The held-out runs, or all of them where none is held out. 0 for a signal whose residual is noise.
        """
        runs = self.campaign.runs_for(Use.HOLDOUT) or self.campaign.runs
        shares = {}
        for name, channel in self.campaign.channels.items():
            rows = [run for run in runs if name in run.signals]
            if not rows:
                continue
            residual = np.concatenate([self.after.residuals[run.name][name] for run in rows])
            measured = np.concatenate([run.signals[name] for run in rows])
            excess = max(float(np.nanmean(np.square(residual))) - 1.0, 0.0)
            shares[name] = channel.noise * math.sqrt(excess) / max(float(np.nanstd(measured)), np.finfo(float).tiny)
        return shares

    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Rms residual over noise: {before, calibrated, after} × {fit, holdout} × {overall, each signal}."""
        return self._rms_by_state

    @functools.cached_property
    def _rms_by_state(self) -> dict[str, dict[str, dict[str, float]]]:
        states = {"before": self.before, "calibrated": self.calibrated.residuals, "after": self.after.residuals}
        return {
            state: {use.value: rms_by_signal(self.campaign, rows, use) for use in Use} for state, rows in states.items()
        }
