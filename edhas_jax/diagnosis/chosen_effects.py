"""Fit a campaign's model with effects that the engineer has chosen, added one after the other."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.calibration.fit_problem import FitError
from edhas_jax.diagnosis.calibration.model_file import write_model_file
from edhas_jax.diagnosis.calibration.result import values_of_runs_as_json
from edhas_jax.diagnosis.search.calibrated_model import calibrate
from edhas_jax.diagnosis.search.candidates import Candidate, candidates_for
from edhas_jax.diagnosis.search.evaluated_fit import EvaluatedFit
from edhas_jax.diagnosis.search.screening import ScoreTest
from edhas_jax.diagnosis.search.settled_fit import settle
from edhas_jax.diagnosis.search.trial import TRIAL_STEPS, try_candidate
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.campaign_reader import OF_RUNS
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution

Report = Callable[[str], None]


@dataclasses.dataclass(frozen=True)
class ChosenModel:
    """A model with chosen effects, all uncertain parameters and those of the effects being fitted.

    Attributes:
        effects: the candidates of these effects, in the order in which they were added.
        evaluated: the fit.
        resolution: time steps per sample.
    """

    effects: tuple[Candidate, ...]
    evaluated: EvaluatedFit
    resolution: TimeResolution

    @property
    def name(self) -> str:
        """The ids of the effects with "+" between them; "calibrated" without any."""
        return "+".join(candidate.id for candidate in self.effects) or "calibrated"

    def rms_over_noise(self) -> dict[str, dict[str, float]]:
        """Rms of residual over noise by run and signal."""
        return {
            run: {name: rms_over_noise([values]) for name, values in row.items()}
            for run, row in self.evaluated.residuals.items()
        }

    def as_json(self) -> dict[str, Any]:
        """The effects, their sizes with standard errors (SI), and the errors, as plain data."""
        fit = self.evaluated.fit
        errors = {use.value: self.evaluated.rms_over_noise(use) for use in Use}
        return {
            "effects": [candidate.id for candidate in self.effects],
            "parameters": {
                u.name: {"value": fit.values[u.name], "std": fit.standard_errors[u.name], "unit": u.unit}
                for candidate in self.effects
                for u in candidate.own_unknowns(fit.problem.unknowns).values()
            },
            OF_RUNS: values_of_runs_as_json(fit),
            "error": {use: value if math.isfinite(value) else None for use, value in errors.items()},
            "error_by_run": self.rms_over_noise(),
        }


@single_threaded_algebra
def calibrated_model(campaign: Campaign, on_progress: Report | None = None) -> ChosenModel:
    """The model without any chosen effect, its uncertain parameters fitted.

    Raises:
        FitError: there is nothing to fit, or the model cannot be fitted.
    """
    return ChosenModel((), *calibrate(campaign, on_progress))


@single_threaded_algebra
def with_effect(
    campaign: Campaign, before: ChosenModel, kind: type[Effect], on_progress: Report | None = None,
    max_steps: int = TRIAL_STEPS,
) -> ChosenModel:  # fmt: skip
    """Add one more effect to a fitted model, and fit everything again.

    Args:
        campaign: the measurements that `before` was fitted to.
        before: the model with the effects chosen so far.
        kind: class of the effect.
        on_progress: called with a sentence on the progress.
        max_steps: maximum number of Levenberg-Marquardt steps.

    Raises:
        FitError: the machine cannot have the effect, or the model cannot be fitted with it.
    """
    report = on_progress or (lambda sentence: None)
    baseline = before.evaluated
    machine = baseline.fit.problem.machine
    possible = {c.id: c for c in candidates_for(campaign, machine, Instruments(), (kind,)) if c.signal is None}
    if kind.id not in possible:
        raise FitError(f"{kind.id} cannot be added to {campaign.name}: its machine has it already, or no slot for it")
    report(f"fitting with {kind.id}")
    score = ScoreTest(baseline.fit, before.effects).score(possible[kind.id])
    trial = try_candidate(baseline, before.effects, score, before.resolution, max_steps)
    if trial.evaluated is None:
        raise FitError(f"the model with {kind.id} fails (it is not finite) wherever the fit has looked")
    settled = settle(trial.evaluated, before.resolution, report)
    return ChosenModel((*before.effects, possible[kind.id]), settled, before.resolution)


def fit_with_effects(
    campaign: Campaign, kinds: Sequence[type[Effect]], on_progress: Report | None = None
) -> list[ChosenModel]:
    """Fit the model of a campaign without, with the first, with the first two, … of some effects.

    Args:
        campaign: the measurements.
        kinds: classes of the effects, in the order in which they are added.
        on_progress: called with a sentence on the progress.

    Returns:
        The calibrated model, and the model after each effect.

    Raises:
        FitError: there is nothing to fit, the model cannot be fitted, or the machine cannot have an effect.
    """
    models = [calibrated_model(campaign, on_progress)]
    for kind in kinds:
        models.append(with_effect(campaign, models[-1], kind, on_progress))
    return models


def save_model(model: ChosenModel, path: Path) -> None:
    """Write a model with chosen effects as a configuration, without the conditions of any run.

    Raises:
        OSError: the file cannot be written.
    """
    write_model_file(path, model.evaluated.fit, f" with {model.name}, fitted; without the conditions of any run")
