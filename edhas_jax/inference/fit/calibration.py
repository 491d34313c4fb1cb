"""Result of a calibration: residuals of all runs before and after, diagnostics of the estimate, and its files."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from edhas_jax.config.run_folder import replace_nonfinite, write_json
from edhas_jax.core.units import format_quantity
from edhas_jax.inference.fit.confounding import (
    AssumedParameter,
    confounding_as_json,
    model_error_sentence,
    weak_combinations,
)
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_choices import FitChoices
from edhas_jax.inference.fit.model_file import write_model_file
from edhas_jax.inference.fit.uncertainty import Drift, ProfileLikelihood
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use, spread_entry
from edhas_jax.measurements.checks.data_summary import data_as_json, data_sentences
from edhas_jax.measurements.fitted_model import OF_RUNS
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel, PredictedSignals
from edhas_jax.measurements.residuals import normalised_residuals, rms_by_signal
from edhas_jax.simulation.integrator import LARGEST_STEP

UNIDENTIFIED_STD = 0.8  # share of the prior's standard deviation above which the data do not identify an unknown
CONFOUNDED_CORRELATION = 0.95  # correlation above which two unknowns cannot be separated
IMPLAUSIBLE_DISTANCE = 2.5  # distance from the prior mean, in prior standard deviations
DRIFT_SCORE = 3.5  # score of a run's own estimate that chance rarely reaches among some hundred
MAX_LISTED_RUNS = 4  # in a sentence on drift, those furthest from the common value
NOT_CONVERGED = "The fit has not converged: the values are those of its last step."
STOPPED = "The fit was stopped: the values are the best until then."
CONFIG_FILE, RESULT_FILE = "config.yaml", "fit.json"


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A fit with the checks of its estimate.

    Attributes:
        fit: the estimate.
        drift: estimates of each run alone; None if not computed.
        profiles: the profile likelihoods that were requested.
        before: (measured − model)/noise of all runs before the fit, by run and signal, shape (samples,) each.
        after: the same after the fit.
        seconds: computing time.
        assumed: parameters taken as known whose error the unknowns would hide.
        choices: what was chosen for the fit; residuals are over the noise of the sensors, without the chosen factors.
        given: the campaign before anything was chosen; None where nothing was.
    """

    fit: Fit
    drift: Drift | None
    profiles: tuple[ProfileLikelihood, ...]
    before: dict[str, dict[str, np.ndarray]]
    after: dict[str, dict[str, np.ndarray]]
    seconds: float
    assumed: tuple[AssumedParameter, ...] = ()
    choices: FitChoices = FitChoices()
    given: Campaign | None = None

    def rms_residuals(self) -> dict[str, dict[str, dict[str, float]]]:
        """Root mean square of residual over noise: {before, calibrated} × {fit, holdout} × {overall, each signal}."""
        campaign = self.fit.problem.campaign
        states = {"before": self.before, "calibrated": self.after}
        return {
            state: {use.value: rms_by_signal(campaign, residuals, use) for use in Use}
            for state, residuals in states.items()
        }

    def unidentified(self) -> list[str]:
        """The unknowns about which the measurements contain next to no information."""
        rows = zip(self.fit.problem.unknowns, self.fit.std, strict=True)
        return [u.name for u, std in rows if u.has_prior and std > UNIDENTIFIED_STD]

    def confounded_pairs(self) -> list[tuple[str, str, float]]:
        """Pairs of unknowns that the measurements cannot separate, with the correlation of their estimates."""
        names, correlation = [u.name for u in self.fit.problem.unknowns], self.fit.correlation
        rows, columns = np.nonzero(np.triu(np.abs(correlation) > CONFOUNDED_CORRELATION, 1))
        return [(names[i], names[j], float(correlation[i, j])) for i, j in zip(rows, columns, strict=True)]

    def implausible(self) -> list[str]:
        """The unknowns whose estimates lie far from their prior means."""
        rows = zip(self.fit.problem.unknowns, self.fit.x, strict=True)
        return [u.name for u, x in rows if u.has_prior and abs(x) > IMPLAUSIBLE_DISTANCE]

    def drifting(self) -> list[str]:
        """The unknowns whose estimates differ from run to run, the largest difference first."""
        if self.drift is None or not self.drift.runs:
            return []
        drift = self.drift
        worst = np.nan_to_num(np.abs(drift.score)).max(axis=0)
        # where all runs agree with each other but not with the common value, that is wrong because of another unknown
        apart = np.abs(drift.x[:, None] - drift.x) / np.sqrt(np.square(drift.std[:, None]) + np.square(drift.std))
        worst = np.minimum(worst, np.nan_to_num(apart).max(axis=(0, 1)))
        return [self.fit.problem.unknowns[k].name for k in np.argsort(-worst) if worst[k] > DRIFT_SCORE]

    def warning(self) -> str | None:
        """That the search was stopped or has not converged; None where it has."""
        return STOPPED if self.fit.stopped else None if self.fit.converged else NOT_CONVERGED

    def findings(self) -> list[str]:
        """Conclusions on the fit as sentences, the most important first."""
        rms, sentences = self.rms_residuals()["calibrated"], []
        use = Use.HOLDOUT if rms["holdout"] else Use.FIT
        overall = rms[use.value]["overall"]
        runs = "held-out runs" if use is Use.HOLDOUT else "fitted runs (none is held out)"
        worst = max((n for n in rms[use.value] if n != "overall"), key=rms[use.value].__getitem__)
        signal = f"worst signal {worst}, {rms[use.value][worst]:.2f}"
        if (warning := self.warning()) is not None:
            sentences.append(warning)
        sentences.append(f"Residual over noise on the {runs}: {overall:.2f}; {signal}.")
        sentences += [] if self.given is None else self.choices.sentences(self.given)
        sentences += own_values_sentences(self.fit)
        if (larger := model_error_sentence(rms[Use.FIT.value]["overall"])) is not None:
            sentences.append(larger)
        pairs = self.fit.at_order
        if limits := [name for name in self.fit.at_limit if not any(name in pair for pair in pairs)]:
            listed = ", ".join(f"{name} {self.fit.text(name)}" for name in limits)
            sentences.append(f"At a limit of the range in which it was sought, so without a standard error: {listed}.")
        sentences += [
            f"{larger} and {smaller} are equal: the law asks that the first is at least the second, and the "
            "measurements want it smaller. Neither has a standard error."
            for larger, smaller in pairs
        ]
        if implausible := self.implausible():
            pulls = dict(zip((u.name for u in self.fit.problem.unknowns), self.fit.x, strict=True))
            order = sorted(implausible, key=lambda n: -abs(pulls[n]))
            listed = ", ".join(f"{name} ({pulls[name]:+.1f} times its stated spread)" for name in order)
            sentences.append(f"Estimated far from the prior: {listed}. They may compensate for physics that the model "
                             "lacks.")  # fmt: skip
        for name in self.drifting()[:3]:
            sentences.append(self._drift_sentence(name))
        for name in self.unidentified():
            sentences.append(f"These runs contain next to no information about {name}: its estimate is its prior.")
        combinations = weak_combinations(self.fit)
        sentences += [combination.sentence() for combination in combinations]
        sentences += [parameter.sentence() for parameter in self.assumed]
        for one, other, correlation in self.confounded_pairs():
            if any({one, other} <= set(combination.changes) for combination in combinations):
                continue
            pair = f"{one} and {other} cannot be told apart (correlation {correlation:+.3f})"
            sentences.append(f"{pair}: a combination of them is known well, each alone less so.")
        return data_sentences(self.fit.problem.campaign, sentences)

    def _drift_sentence(self, name: str) -> str:
        k = [u.name for u in self.fit.problem.unknowns].index(name)
        u, drift, values = self.fit.problem.unknowns[k], self.drift, self.values_of_runs()[name]
        scores = np.nan_to_num(np.abs(drift.score[:, k]))
        worst = sorted(r for r in np.argsort(-scores)[:MAX_LISTED_RUNS] if scores[r] > DRIFT_SCORE)
        listed = ", ".join(f"{format_quantity(values[drift.runs[r]], u.unit)} in {drift.runs[r]}" for r in worst)
        sentence = (
            f"{name} drifts from run to run when each is fitted alone: {listed} "
            f"({scores.max():.0f} standard deviations from the common value): a sign of missing physics"
        )
        spread = self.fit.problem.campaign.uncertain.get(name)
        if spread is None:
            return f"{sentence}."
        remedy = f"{name}: {{{spread_entry(spread, u.unit)}, per: run}}"
        return f"{sentence}, or each run has a value of its own; then write `{remedy}` under `uncertain`."

    def values_of_runs(self) -> dict[str, dict[str, float]]:
        """By unknown, its values (SI) in the runs that were fitted alone and in which it acts."""
        model, drift = self.fit.problem.model(), self.drift
        places = {run.whole: r for r, run in enumerate(model.runs)}
        of_chain = [self.fit.problem.instruments.find(u.name) is not None for u in model.unknowns]
        return {
            u.name: {
                run: float(u.value(x)) if of_chain[k] else model.run_value(places[run], u, x)
                for run, x in zip(drift.runs, drift.x[:, k], strict=True)
                if np.isfinite(x)
            }
            for k, u in enumerate(model.unknowns)
        }


def own_values_sentences(fit: Fit) -> list[str]:
    """That held-out runs have told the values that they have of their own themselves; empty where none has any."""
    if fit.of_other_runs is None:
        return []
    listed = ", ".join(
        f"{u.name} {format_quantity(fit.of_other_runs.values[u.name], u.unit)}"
        for u in fit.of_other_runs.problem.unknowns[:MAX_LISTED_RUNS]
    )
    more = ", …" if len(fit.of_other_runs.problem.unknowns) > MAX_LISTED_RUNS else ""
    return [f"What held-out runs have of their own is estimated from their own samples, all else held: {listed}{more}."]


def campaign_residuals(
    campaign: Campaign, machine: Rig, instruments: Instruments, per_sample: int
) -> dict[str, dict[str, np.ndarray]]:
    """(measured − model)/noise for all runs of a campaign.

    Args:
        campaign: measured runs.
        machine: the machine to simulate.
        instruments: its measurement chains.
        per_sample: integration steps per sample.

    Returns:
        By run and signal, shape (samples,) each; NaN where a sample is missing.
    """
    outcomes = simulate_campaign(campaign, machine, instruments, per_sample)
    return {run.name: normalised_residuals(campaign, run, outcomes[run.name]) for run in campaign.runs}


def simulate_campaign(
    campaign: Campaign, machine: Rig, instruments: Instruments, per_sample: int
) -> dict[str, PredictedSignals]:
    """The sensor signals (SI) that a machine predicts for all runs of a campaign, by run.

    Args:
        campaign: conditions and sampling of the runs.
        machine: the machine to simulate.
        instruments: its measurement chains.
        per_sample: integration steps per sample.
    """
    model = MeasurementModel(campaign, machine, (), campaign.runs, instruments)
    outcomes = model.predict_all_runs(np.zeros(0), per_sample)
    return {run.name: outcomes[r] for r, run in enumerate(campaign.runs)}


def save_calibration(calibration: Calibration, folder: Path, failures: Sequence[str] = ()) -> None:
    """Write `config.yaml`, which `edhas simulate` runs, and `fit.json` into an existing folder.

    Args:
        calibration: the fit with the checks that are finished.
        folder: an existing folder.
        failures: a sentence on each check that could not be made.
    """
    fit = calibration.fit
    interval = min(run.interval for run in fit.problem.campaign.runs)
    data = calibration_as_json(calibration) | {"failed_parts": list(failures)}
    write_json(folder / RESULT_FILE, replace_nonfinite(data))
    remark = ", calibrated by `edhas fit`; without the conditions of any run"
    write_model_file(folder / CONFIG_FILE, fit, remark, step=min(interval / fit.resolution.fine, LARGEST_STEP))


def estimates_as_json(fit: Fit) -> dict[str, dict]:
    """Value, standard error and unit (SI) of every unknown, as plain data; the limit at which it lies, if any."""
    units = {u.name: u.unit for u in fit.problem.unknowns}
    errors, limits = replace_nonfinite(fit.standard_errors), fit.at_limit
    return {
        n: {"value": v, "std": errors[n], "unit": units[n]} | ({"limit": limits[n]} if n in limits else {})
        for n, v in fit.values.items()
    }


def values_of_runs_as_json(fit: Fit) -> dict[str, dict[str, dict]]:
    """What each run has of its own, by run and parameter; of a held-out run estimated from its samples."""
    found: dict[str, dict[str, dict]] = {}
    for part in (fit, fit.of_other_runs):
        estimates = {} if part is None else estimates_as_json(part)
        for u in (u for u in (() if part is None else part.problem.unknowns) if u.run):
            found.setdefault(u.run, {})[u.parameter] = estimates[u.name]
    return found


def calibration_as_json(calibration: Calibration) -> dict:
    """The content of `fit.json`: estimates and standard errors in SI, diagnostics, findings."""
    fit = calibration.fit
    names = [u.name for u in fit.problem.unknowns]
    out = {
        "campaign": fit.problem.campaign.name,
        "data": data_as_json(fit.problem.campaign),
        "choices": {} if calibration.given is None else calibration.choices.as_mapping(calibration.given),
        "calibrated": estimates_as_json(fit),
        OF_RUNS: values_of_runs_as_json(fit),
        "error": calibration.rms_residuals(),
        "converged": fit.converged,
        "stopped": fit.stopped,
        "half_chi_square": fit.cost,
        "step": min(run.interval for run in fit.problem.campaign.runs) / fit.resolution.fine,
        "step_error_over_noise": fit.resolution.error,
        "prior_pull": dict(zip(names, map(float, fit.x), strict=True)),
        "std_over_prior": dict(zip(names, map(float, fit.std), strict=True)),
        "correlation": {
            a: dict(zip(names, map(float, row), strict=True)) for a, row in zip(names, fit.correlation, strict=True)
        },
        "not_identified": calibration.unidentified(),
        "not_told_apart": [[a, b, value] for a, b, value in calibration.confounded_pairs()],
        **confounding_as_json(weak_combinations(fit), calibration.assumed),
        "implausible": calibration.implausible(),
        "drifting": calibration.drifting(),
        "findings": calibration.findings(),
        "seconds": calibration.seconds,
    }
    if calibration.drift is not None:
        out["each_run"] = calibration.values_of_runs()
    out["profile"] = {
        p.name: {"values": p.values.tolist(), "rise": p.chi2_increase.tolist(), "interval_95": p.interval()}
        for p in calibration.profiles
    }
    return out
