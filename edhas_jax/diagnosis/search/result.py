"""What a diagnosis found: the verdict, how it came about, and the model that it leaves behind."""

import dataclasses
import enum
import math
from collections.abc import Iterable

import numpy as np

from edhas_jax.core.units import format_quantity, format_with_error
from edhas_jax.diagnosis.calibration.fit import Fit
from edhas_jax.diagnosis.search.candidates import Suspect, held_by_belief
from edhas_jax.diagnosis.search.evaluated_fit import Judged
from edhas_jax.diagnosis.search.localisation import probabilities
from edhas_jax.diagnosis.search.screening import Score
from edhas_jax.diagnosis.search.trial import Trial
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.residuals import rms_by_signal

TEMPER = 0.1  # exponent of the evidence: models are never exact, so that likelihoods of 10⁴ samples are too sure
UNCONFIRMED = 0.05  # probability that something is missing where new runs confirmed nothing
ALIKE = 20.0  # ratio of probabilities below which two suspects are not told apart
STANDS_IN = 0.5, 0.05  # probability that a suspect, accepted or not, is right where something else is left to explain


class Verdict(enum.Enum):
    """The answer in one word."""

    ADEQUATE = "adequate"
    MISSING_EFFECT = "missing_effect"
    AMBIGUOUS = "ambiguous"
    UNKNOWN_EFFECT = "unknown_effect"


@dataclasses.dataclass(frozen=True)
class Round:
    """One search for one more effect: the model before, what every suspect promised, the trials, what was accepted.

    `forms` are the trials of formulas, the best first, where one of them does better than any effect.
    """

    before: Judged
    scores: tuple[Score, ...]
    trials: tuple[Trial, ...]
    accepted: Trial | None
    forms: tuple[Trial, ...] = ()

    def probabilities(self) -> dict[Suspect | None, float]:
        """The probability of each suspect to be what is missing most, None standing for nothing.

        p ∝ exp(λ · gain), the gain in evidence measured in a trial, or as far as it was promised: a suspect that was
        not tried counts with half of its promise, which a fit seldom reaches.
        """
        gains: dict[Suspect | None, float] = {None: 0.0}
        gains |= {score.suspect: 0.25 * score.fall for score in self.scores}
        gains |= {trial.suspect: trial.gain if math.isfinite(trial.gain) else -1e9 for trial in self.trials}
        if self.accepted is None:  # nothing was confirmed: that one of the many is missing all the same is unlikely
            gains |= {t.suspect: min(t.gain, 0.0) for t in self.trials}
            penalty = math.log(len(self.scores) / UNCONFIRMED) / TEMPER if self.scores else 0.0
            gains = {suspect: gain - penalty * (suspect is not None) for suspect, gain in gains.items()}
        most = max(gains.values())
        weights = {suspect: math.exp(TEMPER * (gain - most)) for suspect, gain in gains.items()}
        total = sum(weights.values())
        return {suspect: weight / total for suspect, weight in weights.items()}

    def group(self) -> list[Suspect]:
        """The suspects that these measurements do not tell apart from the accepted one, it first."""
        if self.accepted is None:
            return []
        p = self.probabilities()
        rivals = [t for t in self.trials if t is not self.accepted and ALIKE * p[t.suspect] > p[self.accepted.suspect]]
        return [self.accepted.suspect, *(t.suspect for t in sorted(rivals, key=lambda t: -t.gain))]


def accepted_in(rounds: Iterable[Round]) -> list[Trial]:
    """The effects that some rounds have accepted, in the order in which they were found."""
    return [r.accepted for r in rounds if r.accepted is not None]


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """The answer to: why does the real machine not behave like the model?

    `rounds` are the searches, one effect at a time. `before`, `calibrated`, `after`: residuals (measured − model)/noise
    by run and signal of the model as it was, with its parameters fitted, and with what was accepted. `final` is the fit
    of the last. `parts`: where something is left to explain, the share of what calibration left over that each part of
    the machine accounts for.
    """

    campaign: Campaign
    verdict: Verdict
    rounds: tuple[Round, ...]
    before: dict[str, dict[str, np.ndarray]]
    calibrated: Judged
    after: Judged
    seconds: float
    parts: dict[str, float]

    @property
    def final(self) -> Fit:
        """The fit of the model that the diagnosis ends with."""
        return self.after.fit

    @property
    def accepted(self) -> list[Trial]:
        """The effects that were accepted, in the order in which they were found."""
        return accepted_in(self.rounds)

    @property
    def forms(self) -> tuple[Trial, ...]:
        """The formulas that were tried for what no effect explains, the best first."""
        return self.rounds[-1].forms

    def groups(self) -> list[list[Suspect]]:
        """Suspects that cannot be told apart, one list for each effect that has rivals."""
        return [group for r in self.rounds if len(group := r.group()) > 1]

    def candidates(self) -> list[tuple[Suspect, float, Trial | None]]:
        """Every suspect with the probability that it is missing and its trial, the most probable first."""
        found: dict[Suspect, tuple[float, Trial | None]] = {}
        for r in self.rounds:
            trials = {t.suspect: t for t in r.trials}
            for suspect, p in r.probabilities().items():
                if suspect is not None:
                    most, trial = found.get(suspect, (0.0, None))
                    found[suspect] = max(p, most), trial or trials.get(suspect)
        if self.verdict is Verdict.UNKNOWN_EFFECT:  # what was accepted may only stand in for what is missing
            accepted, (most, least) = {t.suspect for t in self.accepted}, STANDS_IN
            found = {s: ((most if s in accepted else least) * p, t) for s, (p, t) in found.items()}
        return [(s, p, t) for s, (p, t) in sorted(found.items(), key=lambda item: -item[1][0])]

    def where(self) -> dict[str, float]:
        """The probability that something is missing in a part of the machine, the most probable first.

        Of `unknown_effect` that of each part to be the one (see `parts`); else of each by itself.
        """
        if self.verdict is Verdict.UNKNOWN_EFFECT:
            return probabilities(self.parts)
        out: dict[str, float] = {}
        for r in self.rounds:
            here: dict[str, float] = {}
            for suspect, p in r.probabilities().items():
                if suspect is not None and (r.accepted is not None or self.verdict is Verdict.ADEQUATE):
                    here[suspect.where] = here.get(suspect.where, 0.0) + p
            out = {part: max(out.get(part, 0.0), here.get(part, 0.0)) for part in {**out, **here}}
        return dict(sorted(out.items(), key=lambda item: -item[1]))

    def sentences(self) -> list[str]:
        """The answer in plain words, the verdict first."""
        use = "holdout" if self.campaign.runs_for(Use.HOLDOUT) else "fit"
        errors = self.errors()
        levels_ = [errors[state][use].get("overall", math.nan) for state in ("before", "calibrated", "after")]
        runs = "runs that no fit has seen" if use == "holdout" else "the fitted runs (none is held out)"
        out = []
        if self.verdict is Verdict.ADEQUATE:
            out.append("Nothing is missing: with its uncertain parameters fitted, the model is as good as the sensors.")
        elif self.verdict is Verdict.UNKNOWN_EFFECT:
            part = next(iter(self.where()), "the machine").replace("_", " ")
            out.append(f"Something is missing that no effect of the library explains; most likely it acts on {part}.")
            if self.forms and self.forms[0].judged is not None:
                form = self.forms[0]
                value = form.judged.fit.values[f"{form.suspect.prefix}coefficient"]
                unit = form.suspect.kind.slots[0].unit
                term = f"{format_quantity(value, unit)} · {form.suspect.kind.text}"
                out.append(
                    f"The form that explains most of it: {term}, added as {form.suspect.kind.slots[0].name}; "
                    f"residual over noise then {form.judged.level(Use(use)):.2f}."
                )
            for suspect in (t.suspect for t in self.accepted):
                for name in held_by_belief(suspect, self.final):
                    u = suspect.own(self.final.problem.unknowns)[name]
                    value = format_quantity(self.final.values[u.name], u.unit)
                    out.append(f"{suspect.name} only stands in for it: its {name} would be {value} or beyond.")
        else:
            sizes = [f"{t.suspect.name} ({self._size(t.suspect)})" for t in self.accepted]
            out.append(f"{' and '.join(sizes)} {'is' if len(sizes) == 1 else 'are'} missing.")
        for group in self.groups():
            names = " and ".join(suspect.name for suspect in group)
            out.append(f"These runs cannot tell {names} apart.")
        out.append(
            f"Residual over noise on {runs}: {levels_[0]:.2f} as it was, {levels_[1]:.2f} calibrated"
            + ("." if self.verdict is Verdict.ADEQUATE else f", {levels_[2]:.2f} with what was accepted.")
        )
        return out

    def _size(self, suspect: Suspect) -> str:
        """A suspect's own parameters as text, with their standard errors."""
        fit, own = self.final, suspect.own(self.final.problem.unknowns)
        return ", ".join(
            f"{name} {format_with_error(fit.values[u.name], fit.standard_errors[u.name], u.unit)}"
            for name, u in own.items()
        )

    def errors(self) -> dict[str, dict[str, dict[str, float]]]:
        """Residual over noise: {before, calibrated, after} × {fit, holdout} × {overall, each signal}."""
        states = {"before": self.before, "calibrated": self.calibrated.residuals, "after": self.after.residuals}
        return {
            state: {use.value: rms_by_signal(self.campaign, rows, use) for use in Use} for state, rows in states.items()
        }
