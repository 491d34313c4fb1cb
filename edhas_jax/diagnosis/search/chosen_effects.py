"""Fit a campaign's model with effects that the engineer has chosen, added one after the other."""

import dataclasses
import math
from collections.abc import Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.candidates.candidate import (
    PLAUSIBLE_COORDINATE,
    Candidate,
    candidates_for,
    from_absence,
    with_candidates,
)
from edhas_jax.diagnosis.search.posterior import CONFOUNDED_ODDS
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import signature_table
from edhas_jax.inference.fit.calibrated_model import Report, calibrate
from edhas_jax.inference.fit.calibration import estimates_as_json, values_of_runs_as_json
from edhas_jax.inference.fit.evaluated_fit import EvaluatedFit, fit_coarse
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.inference.fit.model_file import write_model_file
from edhas_jax.inference.fit.settled_fit import settled_with_effects
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.fitted_model import OF_RUNS
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.residuals import rms_over_noise
from edhas_jax.measurements.time_resolution import TimeResolution
from edhas_jax.measurements.unknown_parameters import ParameterScale

CANDIDATE_STEPS = 12  # maximum number of Levenberg-Marquardt steps
USES = {Use.FIT: "fitted runs", Use.HOLDOUT: "held-out runs"}


@dataclasses.dataclass(frozen=True)
class ChosenModel:
    """A model with chosen effects, all uncertain parameters and those of the effects being fitted.

    Attributes:
        effects: the candidates of these effects, in the order in which they were added.
        evaluated: the fit.
        resolution: time steps per sample.
        fading: the sizes, by name, of effects that fade as they grow.
        before: the model without the last of the effects; None without any.
    """

    effects: tuple[Candidate, ...]
    evaluated: EvaluatedFit
    resolution: TimeResolution
    fading: frozenset[str] = frozenset()
    before: "ChosenModel | None" = None

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

    @property
    def needs_no_effect(self) -> str:
        """A sentence where the model without the last effect is as good; empty where this one is better.

        It is better if its evidence is so much larger that the two would not count as confounded, and if it predicts
        the held-out runs better.
        """
        if self.before is None:
            return ""
        with_it, without = self.evaluated, self.before.evaluated
        gain = with_it.log_evidence - without.log_evidence
        fall = without.holdout_half_chi_square().sum() - with_it.holdout_half_chi_square().sum()
        if gain > math.log(CONFOUNDED_ODDS) and fall > 0.0:
            return ""
        errors = ", ".join(
            f"{without.rms_over_noise(use):.3f} without and {with_it.rms_over_noise(use):.3f} with it on the {runs}"
            for use, runs in USES.items()
            if math.isfinite(with_it.rms_over_noise(use))
        )
        return f"The model without {self.effects[-1].id} is as good: residual over noise {errors}."

    def as_json(self) -> dict[str, Any]:
        """The effects, their sizes with standard errors (SI), and the errors, as plain data.

        The standard error of a size at a limit of its range is None, and `limit` says which one it is.
        """
        fit = self.evaluated.fit
        estimates = estimates_as_json(fit)
        errors = {use.value: self.evaluated.rms_over_noise(use) for use in Use}
        return {
            "effects": [candidate.id for candidate in self.effects],
            "parameters": {
                u.name: estimates[u.name]
                for candidate in self.effects
                for u in candidate.own_unknowns(fit.problem.unknowns).values()
            },
            OF_RUNS: values_of_runs_as_json(fit),
            "error": {use: value if math.isfinite(value) else None for use, value in errors.items()},
            "error_by_run": self.rms_over_noise(),
            "bench_corrected": self.evaluated.bench.has_deviations,
            "needs_no_effect": self.needs_no_effect,
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
    max_steps: int = CANDIDATE_STEPS,
) -> ChosenModel:  # fmt: skip
    """Add one more effect to a fitted model, and fit everything again.

    The sizes of chosen effects may come to nothing, so that an effect that is absent is found to be so.

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
    candidate = possible[kind.id]
    table = signature_table(baseline.fit, [candidate], report, with_free_terms=False)
    search = SetSearch(baseline, table, before.resolution, report)
    trials = [found.evaluated for move in search.additions() if (found := search.fit_of(move)) is not None]
    fades = any(signatures.exponent < 0.0 for signatures in table.candidates)
    fading = before.fading | {u.name for u in candidate.unknowns(campaign)[:1] if fades}
    effects = (*before.effects, candidate)
    found = _free_to_vanish(baseline, effects, fading, trials[0] if trials else None, max_steps, before.resolution)
    if found is None:
        raise FitError(f"the model with {kind.id} fails (it is not finite) wherever the fit has looked")
    settled = settled_with_effects(found, before.resolution, report)
    return ChosenModel(effects, settled, before.resolution, fading, before)


def _free_to_vanish(
    baseline: EvaluatedFit, effects: Sequence[Candidate], fading: Set[str], trial: EvaluatedFit | None, max_steps: int,
    resolution: TimeResolution,
) -> EvaluatedFit | None:  # fmt: skip
    """The fit with one more effect, repeated with sizes that may come to nothing where an effect is weak or useless.

    Args:
        baseline: the model without the last of the effects.
        effects: the chosen effects.
        fading: names of the sizes with which an effect fades as they grow.
        trial: the fit with it, its sizes on logarithmic scales; None if it has failed.
        max_steps: maximum number of Levenberg-Marquardt steps.
        resolution: coarse and fine time steps per sample.
    """
    problem = with_candidates(baseline.fit.problem, effects[-1:]) if trial is None else trial.fit.problem
    is_useless = trial is None or not trial.cost < baseline.cost
    freed = {u.name: u for u in problem.unknowns}
    for effect in effects:
        sizes = {effect.prefix + p.name: p.span for p in effect.sizes()}
        sizes = {n: span for n, span in sizes.items() if freed[n].scale is ParameterScale.LOGARITHMIC}
        values = {} if trial is None else trial.fit.values
        weakness = [(1.0 if n in fading else -1.0) * freed[n].coordinate(values[n]) for n in sizes if n in values]
        if max(weakness, default=0.0) > PLAUSIBLE_COORDINATE or (effect is effects[-1] and is_useless):
            freed |= {n: from_absence(freed[n], span, n in fading) for n, span in sizes.items()}
    unknowns = tuple(freed.values())
    starts = [] if trial is None else [[u.coordinate(trial.fit.values[u.name]) for u in unknowns]]
    if is_useless:
        last = effects[-1]
        shape = {u.name: float(u.value(0.0)) for u in last.unknowns(problem.campaign)}
        shape |= {} if trial is None else trial.fit.values
        absent = {n: math.inf if n in fading else 0.0 for n in (last.prefix + p.name for p in last.sizes())}
        values = shape | absent | baseline.fit.values
        starts.append([u.coordinate(values[u.name]) for u in unknowns])
    elif unknowns == problem.unknowns and trial.fit.converged:
        return trial
    problem = dataclasses.replace(problem, unknowns=unknowns)
    try:
        return fit_coarse(problem, np.array(starts), resolution.coarse, max_steps)
    except FitError:
        return trial


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
