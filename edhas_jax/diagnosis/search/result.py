"""The result of a diagnosis: verdict, the rounds of the search with posterior probabilities, and the final model."""

import dataclasses
import enum
import functools
import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from edhas_jax.diagnosis.calibration.confounding import AssumedParameter
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.likelihood.bench_deviations import DeviationKind
from edhas_jax.diagnosis.likelihood.bench_estimate import EstimatedDeviation
from edhas_jax.diagnosis.likelihood.time_correction import with_time_errors
from edhas_jax.diagnosis.search.answer import FURTHER_REAL, NOTHING, UNKNOWN, Answer, Evidence, Rivals, answer_from
from edhas_jax.diagnosis.search.calibrated_model import misfit
from edhas_jax.diagnosis.search.candidates import Candidate
from edhas_jax.diagnosis.search.decision_rules import remaining
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.holdout_split import FITTED_NAME, HELD_OUT_NAME
from edhas_jax.diagnosis.search.law_deviation import LawDeviation
from edhas_jax.diagnosis.search.localisation import location_probabilities
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import rms_by_signal

SHOWN_SIGMAS, MIN_SHOWN_DEVIATION = 3.0, 0.5  # of a deviation of the bench: standard errors, and accuracies
MIN_NAME_PROBABILITY = 0.4  # of an effect that is named beside the first
CONFOUNDED_ODDS = 20.0  # ratio of probabilities below which two candidates are confounded


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
        laws: deviations of the laws of this candidate and of earlier ones that the next round has mounted beside them.
    """

    baseline: EvaluatedFit
    scores: tuple[Score, ...]
    trials: tuple[Trial, ...]
    accepted: Trial | None
    laws: tuple[LawDeviation, ...] = ()

    def with_trial(self, trial: Trial) -> "Round":
        """The round with another version of one of its trials, accepted where that one is."""
        trials = tuple(trial if t.candidate == trial.candidate else t for t in self.trials)
        is_accepted = self.accepted is not None and self.accepted.candidate == trial.candidate
        return dataclasses.replace(self, trials=trials, accepted=trial if is_accepted else self.accepted)


def accepted_trials(rounds: Iterable[Round]) -> list[Trial]:
    """The accepted trials of some rounds, in their order."""
    return [r.accepted for r in rounds if r.accepted is not None]


def mounted_candidates(rounds: Iterable[Round]) -> list[Candidate]:
    """What some rounds have added to the model, in its order: accepted candidates and deviations of their laws."""
    return [c for r in rounds if r.accepted is not None for c in (r.accepted.candidate, *r.laws)]


class MemberTest(NamedTuple):
    """What an accepted candidate contributes to the final model.

    Args:
        candidate: the candidate.
        gain: log-evidence gain [nats] over the refitted model without it, beyond deviations of the other laws.
        left_out_gain: the same for the prediction of each fitted run from the others.
        strength: gain over what is left unexplained with it.
        implausible: its parameters that the data demand to be at the bound of their priors.
        law_gain: fall of ½χ² by a deviation of its law from that of the library [nats].
        law_differs: whether that fall is clear.
    """

    candidate: Candidate
    gain: float
    left_out_gain: float
    strength: float
    implausible: tuple[str, ...] = ()
    law_gain: float = 0.0
    law_differs: bool = False


class Rejected(NamedTuple):
    """A candidate that the backward pass has taken out: the round that accepted it, and its test."""

    round: Round
    test: MemberTest


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The result of the search for effects that a model lacks.

    Args:
        campaign: the measurements.
        rounds: the steps of the search, one effect each; the last one accepted nothing.
        before: (measured − model)/noise by run and signal, of the model as it was given.
        calibrated: the model with its uncertain parameters fitted.
        after: the model with the accepted candidates, everything fitted.
        seconds: computing time [s].
        members: the tests of the accepted candidates in the backward pass.
        location_shares: share of the calibrated model's misfit by component, the largest first; empty where nothing is
            left unexplained.
        free_trials: fits of free terms (curves, memories) for what is left unexplained, the largest gain first.
        left: excess of ½χ² that the final model and deviations of its laws leave, beyond the scatter of noise [nats].
        free_strength: gain of the best free term over what it leaves; 0 where no place was sought.
        holdout_split: a sentence on how runs were divided for want of hold-out runs; empty where there are such runs.
        assumed: parameters taken as known whose error the unknowns of the final model would hide.
        rejected: effects that the backward pass has taken out; they are not ruled out where they explain much.
    """

    campaign: Campaign
    rounds: tuple[Round, ...]
    before: dict[str, dict[str, np.ndarray]]
    calibrated: EvaluatedFit
    after: EvaluatedFit
    seconds: float
    members: tuple[MemberTest, ...]
    location_shares: dict[str, float]
    free_trials: tuple[Trial, ...]
    left: float
    free_strength: float = 0.0
    holdout_split: str = ""
    assumed: tuple[AssumedParameter, ...] = ()
    rejected: tuple[Rejected, ...] = ()

    @functools.cached_property
    def evidence(self) -> Evidence:
        """What the answer follows from."""
        tests = {member.candidate: member for member in self.members}
        found = [(r, tests[r.accepted.candidate]) for r in self.rounds if r.accepted and r.accepted.candidate in tests]
        rivals = [self._rivals(r, test) for r, test in found]
        rivals += [self._rivals(r, test) for r, test in self.rejected if test.candidate not in tests]
        relative = 2.0 * misfit(self.calibrated) / max(self.calibrated.samples, 1)
        share = max(self.location_shares.values(), default=0.0)
        unexplained = max(self._unexplained_shares(self.calibrated, Use.FIT).values(), default=0.0)
        distances = self.calibrated.fit.prior_distances
        distortion = float(np.sqrt(np.mean(np.square(distances)))) if distances.size else 1.0
        return Evidence(tuple(rivals), relative, share, unexplained, distortion, self.free_strength)

    def _rivals(self, of_round: Round, test: MemberTest) -> Rivals:
        """A candidate and those that were tried in its place, without the others that are in the final model."""
        accepted = of_round.accepted
        taken = {t.candidate for t in self.accepted} - {accepted.candidate}
        tried = [t for t in of_round.trials if t.evaluated is not None and t.candidate not in taken]
        gains = {t.candidate.name: t.mean_gain for t in tried} | {accepted.candidate.name: accepted.mean_gain}
        parameters = {t.candidate.name: t.determined_parameters for t in tried}
        costs = {t.candidate.name: t.prior_cost for t in tried if t.prior_cost > 0.0}
        left = remaining(accepted.own_law_excess, self.after.samples)
        implausible = bool(test.implausible)
        return Rivals(test.candidate.name, test.strength, gains, left, implausible, parameters, costs)

    @functools.cached_property
    def answer(self) -> Answer:
        """Probabilities of all names, of nothing and of an unknown cause, and the set that holds the truth."""
        return answer_from(self.evidence)

    @functools.cached_property
    def verdict(self) -> Verdict:
        """The conclusion, from the most probable answer."""
        if self.answer.first == NOTHING:
            return Verdict.ADEQUATE
        if self.answer.first == UNKNOWN:
            return Verdict.UNKNOWN_EFFECT
        return Verdict.AMBIGUOUS if self.confounded_groups() else Verdict.MISSING_EFFECT

    def bench_deviations(self) -> list[EstimatedDeviation]:
        """The deviations of the bench that the runs show clearly, the largest in units of its accuracy first.

        Each has one row: the parts of a filter add up, and what the parts of a divided record show is averaged.
        """
        found = []
        for row in _of_records(with_time_errors(self.after.fit.problem, self.after.bench)):
            if abs(row.value) > SHOWN_SIGMAS * row.std and abs(row.value) > MIN_SHOWN_DEVIATION:
                found.append(row)
        return sorted(found, key=lambda row: -abs(row.value))

    def unexplained_shares(self) -> dict[str, float]:
        """What the final model leaves of each signal beyond the noise, over the rms of the signal, on new runs.

        The held-out runs, or all of them where none is held out. 0 for a signal whose residual is noise.
        """
        return self._unexplained_shares(self.after, Use.HOLDOUT)

    def _unexplained_shares(self, model: EvaluatedFit, use: Use) -> dict[str, float]:
        runs = self.campaign.runs_for(use) or self.campaign.runs
        shares = {}
        for name, channel in self.campaign.channels.items():
            rows = [run for run in runs if name in run.signals]
            if not rows:
                continue
            residual = np.concatenate([model.residuals[run.name][name] for run in rows])
            measured = np.concatenate([run.signals[name] for run in rows])
            excess = max(float(np.nanmean(np.square(residual))) - 1.0, 0.0)
            shares[name] = channel.noise * math.sqrt(excess) / max(float(np.nanstd(measured)), np.finfo(float).tiny)
        return shares

    @property
    def final(self) -> Fit:
        """The fit of the final model."""
        return self.after.fit

    @property
    def accepted(self) -> list[Trial]:
        """The accepted trials, in the order of their rounds."""
        return accepted_trials(self.rounds)

    @functools.cached_property
    def named(self) -> list[Trial]:
        """The accepted trials that are named: the first one, and those that are clearly real.

        Others only improve the model. The name of one that is real may still be shared with its rivals.
        """
        names = [member.name for member in self.evidence.members]
        real = dict(zip(names, self.evidence.probabilities_real(), strict=True))
        first, p = self.answer.first, self.answer.probabilities
        return [
            t
            for t in self.accepted
            if t.candidate.name == first
            or (real.get(t.candidate.name, 0.0) >= FURTHER_REAL and p.get(t.candidate.name, 0.0) > MIN_NAME_PROBABILITY)
        ]

    @property
    def laws(self) -> list[LawDeviation]:
        """The deviations of accepted laws that the final model has mounted."""
        return [law for r in self.rounds for law in r.laws]

    @property
    def best_free_trial(self) -> Trial | None:
        """The free term that explains most of an unknown effect; None for any other verdict, or without a fit."""
        if self.verdict is not Verdict.UNKNOWN_EFFECT or not self.free_trials:
            return None
        return self.free_trials[0] if self.free_trials[0].evaluated is not None else None

    def confounded_groups(self) -> list[list[Candidate]]:
        """The groups of candidates that these measurements do not distinguish, the accepted one first."""
        p, groups = self.answer.probabilities, []
        taken = {t.candidate for t in self.accepted}
        for r in self.rounds:
            if r.accepted is None or r.accepted not in self.named:
                continue
            limit = p.get(r.accepted.candidate.name, 0.0)
            rivals = [
                t.candidate
                for t in r.trials
                if t.candidate not in taken and CONFOUNDED_ODDS * p.get(t.candidate.name, 0.0) > limit > 0.0
            ]
            if rivals:
                groups.append([r.accepted.candidate, *rivals])
        return groups

    def ranked_candidates(self) -> list[tuple[Candidate, float, Trial | None]]:
        """All candidates with the probability to be missing and their trial, the most probable first."""
        found: dict[Candidate, tuple[float, Trial | None]] = {}
        for r in self.rounds:
            trials = {t.candidate: t for t in r.trials}
            for candidate in (*(s.candidate for s in r.scores), *trials):
                _, trial = found.get(candidate, (0.0, None))
                found[candidate] = self.answer.probabilities.get(candidate.name, 0.0), trial or trials.get(candidate)
        mounted = {t.candidate: r.accepted for r, t in self.rejected} | {t.candidate: t for t in self.accepted}
        found |= {c: (found.get(c, (0.0, None))[0], t) for c, t in mounted.items()}
        return [(c, p, t) for c, (p, t) in sorted(found.items(), key=lambda item: -item[1][0])]

    def location_probabilities(self) -> dict[str, float]:
        """The probability that something is missing in a component, the largest first.

        Of accepted candidates and their rivals by their probabilities; an unknown cause by the shares of the misfit.
        """
        out: dict[str, float] = {}
        for candidate, p, _ in self.ranked_candidates():
            out[candidate.location] = max(out.get(candidate.location, 0.0), p)
        unknown = self.answer.probabilities.get(UNKNOWN, 0.0)
        for name, p in location_probabilities(self.location_shares).items():
            out[name] = out.get(name, 0.0) + unknown * p
        return dict(sorted(((n, p) for n, p in out.items() if p > 0.0), key=lambda item: -item[1]))

    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Rms residual over noise: {before, calibrated, after} × {fit, holdout} × {overall, each signal}."""
        states = {"before": self.before, "calibrated": self.calibrated.residuals, "after": self.after.residuals}
        return {
            state: {use.value: rms_by_signal(self.campaign, rows, use) for use in Use} for state, rows in states.items()
        }


def _of_records(rows: list[EstimatedDeviation]) -> list[EstimatedDeviation]:
    """The deviations with one row for each filter, and one for both parts of a record that was divided."""
    together: dict[tuple, list[EstimatedDeviation]] = {}
    for row in rows:
        record = row.run.removesuffix(FITTED_NAME).removesuffix(HELD_OUT_NAME)
        together.setdefault((row.deviation.kind, row.deviation.name, record), []).append(row)
    found = []
    for (kind, _, record), same in together.items():
        values, stds = np.array([row.value for row in same]), np.array([row.std for row in same])
        value, std = values.sum(), np.sqrt(np.sum(stds**2))
        if kind is not DeviationKind.FILTER:
            weights = 1.0 / np.maximum(stds, np.finfo(float).tiny) ** 2
            value = np.average(values, weights=weights)
            # parts that differ by more than their errors do not determine it any better than that
            std = max(1.0 / np.sqrt(weights.sum()), np.sqrt(np.average((values - value) ** 2, weights=weights)))
        found.append(same[0]._replace(run=record, value=float(value), std=float(std)))
    return found
