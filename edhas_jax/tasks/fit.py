"""Fit: calibrate the uncertain parameters of a campaign's machine."""

import dataclasses
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.core.optional_parts import OptionalParts
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import format_quantity
from edhas_jax.diagnosis.report.calibration_figures import draw_correlations, draw_drift, draw_estimates, draw_profiles
from edhas_jax.diagnosis.report.calibration_report import fit_report
from edhas_jax.inference.fit.calibration import Calibration, campaign_residuals, save_calibration
from edhas_jax.inference.fit.chosen_fit import fit_with_choices
from edhas_jax.inference.fit.confounding import assumed_parameters
from edhas_jax.inference.fit.fit import FitStep
from edhas_jax.inference.fit.fit_choices import FitChoices
from edhas_jax.inference.fit.fit_choices_reader import read_choices
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.inference.fit.uncertainty import fit_each_run, profile_likelihood
from edhas_jax.measurements.campaign import Campaign, CampaignError
from edhas_jax.measurements.campaign_reader import as_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.tasks.compare import errors_table
from edhas_jax.tasks.result import Result


@dataclasses.dataclass(frozen=True, repr=False)
class FitResult(Result, Calibration):
    """The calibrated parameters of a campaign's machine; see `Calibration` for its numbers.

    Attributes:
        failures: a sentence on each check that could not be made.
        interrupted: whether the user has interrupted the search (`fit.stopped`) or the checks after it.
    """

    failures: tuple[str, ...] = ()
    interrupted: bool = False
    files = ("report.html", "fit.json", "config.yaml")

    @property
    def machine(self):
        """The machine with the calibrated parameters."""
        return self.fit.machine

    def summary(self) -> Summary:
        """See `Result.summary`; that a fit was stopped or has not converged is said first."""
        campaign = self.fit.problem.campaign
        title = f"{campaign.name}: {len(self.fit.problem.unknowns)} parameters calibrated in {self.seconds:.0f} s"
        said = self.warning()
        findings = [sentence for sentence in self.findings() if sentence != said]
        warning = [] if said is None else [Toned(said, Tone.BAD)]
        numbered = [f"{number}. {sentence}" for number, sentence in enumerate(findings, 1)]
        tables = errors_table(self.rms_residuals()), self._estimates()
        return Summary(title, (*warning, *tables, *numbered, *self.failures))

    def _estimates(self) -> SummaryTable:
        fit, rows, records = self.fit, [], []
        for u, x, std in zip(fit.problem.unknowns, fit.x, fit.std, strict=True):
            interval, value = fit.interval(u.name), fit.values[u.name]
            rows.append((u.name, format_quantity(u.centre, u.unit), format_quantity(value, u.unit),
                         fit.interval_text(u.name), f"{x:+.2f}", f"{std:.3f}"))  # fmt: skip
            records.append({"name": u.name, "unit": u.unit, "prior_mean": u.centre, "value": value,
                            "interval_95": list(interval), "pull": float(x), "error": float(std)})  # fmt: skip
        columns = "name", "prior mean", "value", "95 % interval", "pull, prior σ", "error, prior σ"
        return SummaryTable.of("unknowns", columns, rows, records, "unknowns")

    def plot(self):
        """Plot every estimate with its interval beside its prior, as a matplotlib figure."""
        return draw_estimates(self)

    def plot_correlations(self):
        """Plot correlations of the estimates, as a matplotlib figure."""
        return draw_correlations(self)

    def plot_drift(self):
        """Plot the estimates of each run alone, as a matplotlib figure.

        Raises:
            ValueError: they could not be computed.
        """
        if self.drift is None:
            raise ValueError("the runs have not been fitted alone")
        return draw_drift(self)

    def plot_profiles(self):
        """Plot the likelihood along the parameters of `profiles`, as a matplotlib figure.

        Raises:
            ValueError: none was asked for.
        """
        if not self.profiles:
            raise ValueError("this fit has no profiles; ask for them with profiles=[name]")
        return draw_profiles(self)

    def report(self) -> str:
        """The report, one HTML page."""
        return fit_report(self)

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        optional = OptionalParts()
        text = optional.attempt("report.html", self.report)
        failures = [*self.failures, *optional.failures]
        save_calibration(self, folder, failures)
        if text is not None:
            (folder / "report.html").write_text(text, encoding="utf-8")
        return failures


def fit(
    campaign: Campaign | Path | str,
    starts: int = 4,
    profiles: Sequence[str] = (),
    trust: Trust = (),
    on_progress: Callable[[str], None] | None = None,
    keep: Callable[[FitResult], None] | None = None,
    choices: FitChoices | Mapping[str, Any] | Path | str | None = None,
    on_step: Callable[[FitStep], None] | None = None,
) -> FitResult:
    """Calibrate the uncertain parameters of a campaign's machine, and check the estimate.

    Args:
        campaign: a campaign or its folder.
        starts: points to start from.
        profiles: uncertain parameters along which the likelihood is wanted, all others fitted anew.
        trust: Python files of your own that may run if the campaign names them.
        on_progress: called with a sentence on the work at hand.
        keep: called with the estimates before the checks begin, so that an interruption loses nothing.
        choices: free and fixed parameters with their limits and priors, runs, signals and time windows, where they
            differ from what the campaign says: a YAML file, or a mapping with the same keys and texts.
        on_step: called after every step of the search, with its cost and the values of the unknowns.

    Returns:
        The estimates. A check that fails or is interrupted costs a sentence. After an interruption of the search they
        are the best until then, without checks, and the result says that it was stopped.

    Raises:
        CampaignError: the campaign or the choices are wrong, a profile is of no free parameter, or the fit fails.
    """
    began = time.perf_counter()
    report, optional = on_progress or (lambda sentence: None), OptionalParts()
    report("checking the data")
    given = checked_campaign(as_campaign(campaign, trust))
    choices = read_choices(choices, given)
    require_uncertain(profiles, [u.name for u in choices.unknowns(choices.applied(given))])
    report("reading")
    try:
        campaign, found = fit_with_choices(given, choices, starts, on_progress=report, on_step=on_step)
    except FitError as error:
        raise CampaignError(str(error)) from None
    report("residuals of all runs")
    fine = found.resolution.fine
    before = campaign_residuals(campaign, given.machine, Instruments(), fine)
    fitted = dataclasses.replace(found.campaign, channels=campaign.channels)
    after = campaign_residuals(fitted, found.machine, found.instruments, fine)
    chosen = {"choices": choices, "given": given} if choices != FitChoices() else {}
    result = FitResult(found, None, (), before, after, time.perf_counter() - began, **chosen)
    if keep is not None:
        keep(result)
    if found.stopped:
        return dataclasses.replace(result, interrupted=True)
    drift, likelihoods, assumed, interrupted = None, [], [], False
    try:
        drift = optional.attempt(
            "The fit of each run alone", lambda: fit_each_run(found, lambda step: report(f"each run alone, {step}"))
        )
        what = "The parameters taken as known"
        assumed = optional.attempt(what, lambda: assumed_parameters(found, report)) or []
        for name in profiles:
            profile = optional.attempt(
                f"The profile of {name}",
                lambda name=name: profile_likelihood(found, name, lambda step: report(f"profile of {name}, {step}")),
            )
            likelihoods += [] if profile is None else [profile]
    except KeyboardInterrupt:
        optional.failures.append("Interrupted: the results so far are written.")
        interrupted = True
    return dataclasses.replace(
        result, drift=drift, profiles=tuple(likelihoods), seconds=time.perf_counter() - began, assumed=tuple(assumed),
        failures=tuple(optional.failures), interrupted=interrupted,
    )  # fmt: skip


def require_uncertain(profiles: Sequence[str], uncertain: Sequence[str]) -> None:
    """Refuse a profile of a parameter that is not uncertain.

    Raises:
        CampaignError: there is one.
    """
    for name in profiles:
        if name not in uncertain:
            raise CampaignError(f"--profile {name}: not an uncertain parameter; these are: {', '.join(uncertain)}")
