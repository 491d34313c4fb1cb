"""The result of a diagnosis: verdict, the rounds of the search with posterior probabilities, and the final model."""

import dataclasses
import enum
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.core.units import format_quantity, format_with_error
from edhas_jax.diagnosis.calibration.confounding import AssumedParameter, model_error_sentence, weak_combinations
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.localisation import location_probabilities
from edhas_jax.diagnosis.search.plausibility import implausible_parameters
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import rms_by_signal

TEMPERING = 0.1  # exponent of the marginal likelihood: models are inexact, which 10⁴ samples would otherwise ignore
UNTRIED_GAIN_SHARE = 0.5  # of its predicted gain, with which a candidate without a trial counts
UNCONFIRMED_ODDS = 0.05  # prior odds, of all candidates together, that one is missing although none was confirmed
CONFOUNDED_ODDS = 20.0  # ratio of probabilities below which two candidates are confounded
# of a candidate where the verdict is an unknown effect: largest probability of an accepted one, factor of any other one
MAX_UNKNOWN_PROBABILITY, UNKNOWN_OTHER_FACTOR = 0.9, 0.05
IMPOSSIBLE_GAIN = -1e9  # nats; a candidate with which the model cannot be fitted


class Verdict(enum.Enum):
    """The conclusion of a diagnosis."""

    ADEQUATE = "adequate"
    MISSING_EFFECT = "missing_effect"
    AMBIGUOUS = "ambiguous"
    UNKNOWN_EFFECT = "unknown_effect"


@dataclasses.dataclass(frozen=True)
class Round:
    """One step of forward selection: the search for one more effect.

    Args:
        baseline: the model before, with the candidates of earlier rounds.
        scores: score tests of all candidates (chi-square scale), the largest predicted fall first.
        trials: the candidates that were fitted.
        accepted: the trial that was accepted; None if none was confirmed.
        generic_trials: trials of generic terms, the largest gain first, where one explains more than any effect.
    """

    baseline: EvaluatedFit
    scores: tuple[Score, ...]
    trials: tuple[Trial, ...]
    accepted: Trial | None
    generic_trials: tuple[Trial, ...] = ()

    def probabilities(self) -> dict[Candidate | None, float]:
        """Posterior probability of each candidate to be the main missing effect; the key None stands for no effect.

        p ∝ exp(λ · gain) with the log-evidence gain of the trial and the tempering exponent λ = 0.1. A candidate
        without a trial counts with half of its predicted gain, which a fit seldom achieves. Where no candidate was
        confirmed, no trial counts with a positive gain, and all candidates share prior odds of 0.05.
        """
        gains: dict[Candidate | None, float] = {None: 0.0}
        gains |= {score.candidate: UNTRIED_GAIN_SHARE * score.predicted_gain for score in self.scores}
        gains |= {
            t.candidate: t.log_evidence_gain if math.isfinite(t.log_evidence_gain) else IMPOSSIBLE_GAIN
            for t in self.trials
        }
        if self.accepted is None:
            gains |= {t.candidate: min(t.log_evidence_gain, 0.0) for t in self.trials}
            penalty = math.log(len(self.scores) / UNCONFIRMED_ODDS) / TEMPERING if self.scores else 0.0
            gains = {candidate: gain - penalty * (candidate is not None) for candidate, gain in gains.items()}
        largest = max(gains.values())
        weights = {candidate: math.exp(TEMPERING * (gain - largest)) for candidate, gain in gains.items()}
        total = sum(weights.values())
        return {candidate: weight / total for candidate, weight in weights.items()}

    def confounded_candidates(self) -> list[Candidate]:
        """The accepted candidate and those that these measurements do not distinguish from it; empty if none is.

        Candidates are confounded where the ratio of their probabilities is below `CONFOUNDED_ODDS`.
        """
        if self.accepted is None:
            return []
        p = self.probabilities()
        limit = p[self.accepted.candidate]
        rivals = [t for t in self.trials if t is not self.accepted and CONFOUNDED_ODDS * p[t.candidate] > limit]
        rivals.sort(key=lambda t: -t.log_evidence_gain)
        return [self.accepted.candidate, *(t.candidate for t in rivals)]


def accepted_trials(rounds: Iterable[Round]) -> list[Trial]:
    """The accepted trials of some rounds, in their order."""
    return [r.accepted for r in rounds if r.accepted is not None]


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of the search for effects that a model lacks.

    Args:
        campaign: the measurements.
        verdict: the conclusion.
        rounds: the steps of forward selection, one effect each.
        before: (measured − model)/noise by run and signal, of the model as it was given.
        calibrated: the model with its uncertain parameters fitted.
        after: the model with the accepted candidates, everything fitted.
        seconds: computing time [s].
        location_shares: for an unknown effect, the share of χ² of the calibrated model's residual by component, the
            largest first; else empty.
        holdout_split: a sentence on how runs were divided for want of hold-out runs; empty where there are such runs.
        assumed: parameters taken as known whose error the unknowns of the final model would hide.
    """

    campaign: Campaign
    verdict: Verdict
    rounds: tuple[Round, ...]
    before: dict[str, dict[str, np.ndarray]]
    calibrated: EvaluatedFit
    after: EvaluatedFit
    seconds: float
    location_shares: dict[str, float]
    holdout_split: str = ""
    assumed: tuple[AssumedParameter, ...] = ()

    @property
    def final(self) -> Fit:
        """The fit of the final model."""
        return self.after.fit

    @property
    def accepted(self) -> list[Trial]:
        """The accepted trials, in the order of their rounds."""
        return accepted_trials(self.rounds)

    @property
    def generic_trials(self) -> tuple[Trial, ...]:
        """The generic terms tried for what no effect explains, the largest gain first."""
        return self.rounds[-1].generic_trials

    @property
    def best_generic_trial(self) -> Trial | None:
        """The generic term that explains most of an unknown effect; None for any other verdict, or without a fit."""
        if self.verdict is not Verdict.UNKNOWN_EFFECT or not self.generic_trials:
            return None
        return self.generic_trials[0] if self.generic_trials[0].evaluated is not None else None

    def confounded_groups(self) -> list[list[Candidate]]:
        """The groups of candidates that these measurements do not distinguish, the accepted one first."""
        return [group for r in self.rounds if len(group := r.confounded_candidates()) > 1]

    def ranked_candidates(self) -> list[tuple[Candidate, float, Trial | None]]:
        """All candidates with the probability to be missing (largest of all rounds) and their trial, sorted by it."""
        found: dict[Candidate, tuple[float, Trial | None]] = {}
        for r in self.rounds:
            trials = {t.candidate: t for t in r.trials}
            for candidate, p in r.probabilities().items():
                if candidate is not None:
                    largest, trial = found.get(candidate, (0.0, None))
                    found[candidate] = max(p, largest), trial or trials.get(candidate)
        if self.verdict is Verdict.UNKNOWN_EFFECT:  # accepted candidates may only imitate the unknown effect
            factors = {t.candidate: self._explained_share(t) for t in self.accepted}
            found = {c: (factors.get(c, UNKNOWN_OTHER_FACTOR) * p, t) for c, (p, t) in found.items()}
        return [(c, p, t) for c, (p, t) in sorted(found.items(), key=lambda item: -item[1][0])]

    def _explained_share(self, trial: Trial) -> float:
        """The probability that an accepted candidate is real although the final model leaves something unexplained.

        The fall of ½χ² of the held-out runs by the candidate, over that fall and the excess of ½χ² over the noise that
        the final model leaves; at most 0.9, and 0.05 where the candidate depends on an implausible parameter.
        """
        if implausible_parameters(trial.candidate, self.final):
            return UNKNOWN_OTHER_FACTOR
        runs = self.campaign.runs_for(Use.HOLDOUT) or self.campaign.runs
        samples = sum(int(np.isfinite(v).sum()) for v in self.after.run_residuals(runs))
        remaining = max(float(self.after.holdout_half_chi_square().sum()) - 0.5 * samples, 0.0)
        fall = max(trial.holdout_half_chi_square_fall, 0.0)
        return MAX_UNKNOWN_PROBABILITY * fall / max(fall + remaining, 1.0)

    def location_probabilities(self) -> dict[str, float]:
        """The probability that something is missing in a component, the largest first.

        For an unknown effect these are the probabilities of each component to be its origin, from the shares of χ²,
        and sum to 1. Otherwise each is the sum over the component's candidates in one round, the largest of all rounds.
        """
        if self.verdict is Verdict.UNKNOWN_EFFECT:
            return location_probabilities(self.location_shares)
        out: dict[str, float] = {}
        for r in self.rounds:
            of_round: dict[str, float] = {}
            for candidate, p in r.probabilities().items():
                if candidate is not None and (r.accepted is not None or self.verdict is Verdict.ADEQUATE):
                    of_round[candidate.location] = of_round.get(candidate.location, 0.0) + p
            out = {name: max(out.get(name, 0.0), of_round.get(name, 0.0)) for name in {**out, **of_round}}
        return dict(sorted(out.items(), key=lambda item: -item[1]))

    def sentences(self) -> list[str]:
        """The result in sentences, the verdict first."""
        use = "holdout" if self.campaign.runs_for(Use.HOLDOUT) else "fit"
        errors = self.errors()
        rms = [errors[state][use].get("overall", math.nan) for state in ("before", "calibrated", "after")]
        runs = "held-out runs" if use == "holdout" else "the fitted runs (none is held out)"
        runs = "the held-out part of the runs" if self.holdout_split else runs
        out = []
        if self.verdict is Verdict.ADEQUATE:
            out.append("Nothing is missing: with its uncertain parameters fitted, the model is as good as the sensors.")
        elif self.verdict is Verdict.UNKNOWN_EFFECT:
            out += self._unknown_effect_sentences(Use(use))
        else:
            sizes = [f"{t.candidate.name} ({self._parameters_text(t.candidate)})" for t in self.accepted]
            out.append(f"{' and '.join(sizes)} {'is' if len(sizes) == 1 else 'are'} missing.")
        for group in self.confounded_groups():
            names = " and ".join(candidate.name for candidate in group)
            out.append(f"These runs cannot distinguish {names}.")
        out.append(
            f"Residual over noise on {runs}: {rms[0]:.2f} as it was, {rms[1]:.2f} calibrated"
            + ("." if self.verdict is Verdict.ADEQUATE else f", {rms[2]:.2f} with the accepted candidates.")
        )
        out += [self.holdout_split] if self.holdout_split else []
        return out + self.uncertainty_sentences()

    def uncertainty_sentences(self) -> list[str]:
        """What the data do not determine, and what the standard errors take for granted."""
        rms = self.errors()["after"]["fit"].get("overall", math.nan)
        larger = model_error_sentence(rms)
        combinations = [combination.sentence() for combination in weak_combinations(self.final)]
        return [*([] if larger is None else [larger]), *combinations, *(a.sentence() for a in self.assumed)]

    def _unknown_effect_sentences(self, use: Use) -> list[str]:
        """Where an unknown effect acts, its best generic term, and accepted candidates at their prior bound."""
        component = next(iter(self.location_probabilities()), "the machine").replace("_", " ")
        out = [f"Something is missing that no effect of the library explains; most likely it acts on {component}."]
        if (best := self.best_generic_trial) is not None:
            kind = best.candidate.kind
            value = best.evaluated.fit.values[f"{best.candidate.prefix}coefficient"]
            term = f"{format_quantity(value, kind.slots[0].unit)} · {kind.text}"
            out.append(
                f"The generic term that explains most of it: {term}, added as {kind.slots[0].name}; "
                f"residual over noise then {best.evaluated.rms_over_noise(use):.2f}."
            )
        for candidate in (t.candidate for t in self.accepted):
            for name in implausible_parameters(candidate, self.final):
                u = candidate.own_unknowns(self.final.problem.unknowns)[name]
                value = format_quantity(self.final.values[u.name], u.unit)
                out.append(f"{candidate.name} only imitates it: its {name} would have to be {value} or beyond.")
        return out

    def _parameters_text(self, candidate: Candidate) -> str:
        """The fitted parameters of a candidate with their standard errors."""
        fit, own = self.final, candidate.own_unknowns(self.final.problem.unknowns)
        return ", ".join(
            f"{name} {format_with_error(fit.values[u.name], fit.standard_errors[u.name], u.unit)}"
            for name, u in own.items()
        )

    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Rms residual over noise: {before, calibrated, after} × {fit, holdout} × {overall, each signal}."""
        states = {"before": self.before, "calibrated": self.calibrated.residuals, "after": self.after.residuals}
        return {
            state: {use.value: rms_by_signal(self.campaign, rows, use) for use in Use} for state, rows in states.items()
        }
