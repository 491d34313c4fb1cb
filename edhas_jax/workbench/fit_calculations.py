"""Calibration for the page: are the choices right, where does a fit stand that runs, how certain is a finished one."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from edhas_jax.core.units import display_unit, format_quantity, from_si
from edhas_jax.diagnosis.report.calibration_figures import profile_chart
from edhas_jax.inference.fit.chosen_fit import fit_with_choices
from edhas_jax.inference.fit.fit import Fit
from edhas_jax.inference.fit.fit_choices_reader import read_choices
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.inference.fit.uncertainty import profile_likelihood
from edhas_jax.machine.parameters import set_parameters
from edhas_jax.measurements.campaign import BenchRun, Campaign, CampaignError
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.residuals import autocorrelation, white_noise_band
from edhas_jax.measurements.time_resolution import choose_time_resolution
from edhas_jax.workbench.campaign_calculations import CampaignCalculations
from edhas_jax.workbench.thinning import thinned
from edhas_jax.workbench.workspace import CALIBRATED, Workspace, WorkspaceError

LAGS_SHARE, MAX_LAGS = 4, 100  # of the autocorrelation: a quarter of the samples (Box, Jenkins), as many as are seen


class FitCalculations:
    """Keeps the last finished fit, and time steps of runs, in memory.

    Args:
        workspace: the folder.
        campaign: reads and checks the campaign, and compares models.
        say: called with a sentence on the progress.
    """

    def __init__(self, workspace: Workspace, campaign: CampaignCalculations, say: Callable[[str], None]):
        self._workspace, self._of_campaign, self._say = workspace, campaign, say
        self._kept: tuple[Any, Fit] | None = None
        self._steps: dict[str, tuple[BenchRun, int]] = {}

    def check(self, choices: Mapping[str, Any]) -> dict[str, Any]:
        """What is wrong with the choices for a fit, and between which values the free parameters are sought.

        Returns:
            `problems`: a sentence each; `limits`: by free parameter as texts, empty where something is wrong.
        """
        given = self._of_campaign.checked()
        try:
            chosen = read_choices(choices, given)
        except CampaignError as error:
            return {"problems": [line.removeprefix("choices: ") for line in str(error).splitlines()], "limits": {}}
        limits = {}
        for u in chosen.unknowns(chosen.applied(given)):
            ends = sorted(float(u.value(x)) for x in u.bounds() if np.isfinite(x))
            limits[u.name] = [format_quantity(end, u.unit) for end in ends] if len(ends) == 2 else ["", ""]
        return {"problems": [], "limits": limits}

    def trajectory(
        self, choices: Mapping[str, Any], values: Mapping[str, float], run: str, signal: str, width: int
    ) -> dict[str, Any] | None:
        """A signal of a run, measured and with the present values of a fit; None where the run does not have it.

        Args:
            choices: what is chosen for the fit: values of fixed parameters.
            values: the values of the unknowns (SI) by name; the others are as given or fixed.
            run: the run.
            signal: the signal.
            width: of the plot, in pixels.
        """
        given = self._of_campaign.checked()
        measured = next((r for r in given.runs if r.name == run and signal in r.signals), None)
        if measured is None:
            return None
        try:
            campaign = read_choices({"parameters": choices.get("parameters") or {}}, given).applied(given)
        except CampaignError:  # while one types
            campaign = given
        (chosen,) = (r for r in campaign.runs if r.name == run)
        own = {n.removesuffix(f" in {chosen.whole}"): v for n, v in values.items() if n.endswith(f" in {chosen.whole}")}
        machine = set_parameters(campaign.machine, {n: v for n, v in values.items() if " in " not in n})
        chosen = dataclasses.replace(chosen, conditions=chosen.conditions | own)
        model = MeasurementModel(campaign, machine, (), (chosen,))
        predicted = model.predict_all_runs(np.zeros(0), self._steps_per_sample(given, measured))[0].values[signal]
        about, time, record = given.machine.signals[signal], measured.time, measured.signals[signal]
        rows = {}
        for name, row in (("measured", record), ("model", predicted)):
            index = thinned(time, row, -np.inf, np.inf, width)
            rows[name] = {"x": time[index], "y": about.shown(row[index])}
        residual = (record - predicted) / given.channels[signal].noise
        over_noise = float(np.sqrt(np.nanmean(np.square(residual)))) if np.isfinite(residual).any() else np.inf
        return rows | {"unit": about.display_unit, "over_noise": over_noise}

    def profile(self, name: str) -> dict[str, Any]:
        """χ² along a parameter of the finished fit, all others fitted anew.

        Returns:
            `chart`; `unit` of the parameter in it; `interval` of 95 % in that unit.
        """
        fit = self._finished()
        names = [u.name for u in fit.problem.unknowns]
        if name not in names:
            raise WorkspaceError(f"{name} is no free parameter of this fit; these are: {', '.join(names)}")
        is_in_order = any(name in pair for pair in fit.at_order)  # χ² rises to both sides: the other goes along
        if name in fit.at_limit and not is_in_order:
            raise WorkspaceError(f"{name} is at its {fit.at_limit[name]} limit, where χ² has no minimum to go up from")
        found = profile_likelihood(fit, name, lambda step: self._say(f"profile of {name}, {step}"))
        unit = next(u.unit for u in fit.problem.unknowns if u.name == name)
        shown = display_unit(unit, float(np.median(found.values)))
        interval = [float(from_si(end, unit, shown)) for end in found.interval()]
        return {"chart": profile_chart(fit, found), "unit": shown, "interval": interval}

    def autocorrelation(self, model: str, run: str, signal: str) -> dict[str, Any] | None:
        """The autocorrelation of the residual of a signal; None where the run does not have it.

        Args:
            model: name of the model.
            run: the run.
            signal: the signal.
        """
        comparison, _ = self._of_campaign.comparison(model, "set_point")
        compared = next((c for c in comparison.runs if c.run.name == run and signal in c.residuals), None)
        if compared is None:
            return None
        residual = compared.residuals[signal]
        lags = max(min(len(residual) // LAGS_SHARE, MAX_LAGS), 1)
        return {
            "lag": 1e3 * compared.run.interval * np.arange(lags + 1), "value": autocorrelation(residual, lags),
            "band": white_noise_band(residual),
        }  # fmt: skip

    def _finished(self) -> Fit:
        """The finished fit of the folder, with its derivatives; computed again from its values, which is quick."""
        written = self._workspace.result(CALIBRATED)
        if written is None:
            raise WorkspaceError("there is no finished fit: calibrate first")
        given = self._of_campaign.checked()
        of = self._workspace.result_time(CALIBRATED), id(given)
        if self._kept is None or self._kept[0] != of:
            self._say("the fit again, from its values")
            choices = read_choices(written.get("choices") or {}, given)
            unknowns = choices.unknowns(choices.applied(given))
            values = {name: row["value"] for name, row in written["calibrated"].items()}
            if set(values) != {u.name for u in unknowns}:
                raise WorkspaceError("campaign.yaml has other uncertain parameters than this fit: calibrate again")
            start = np.array([[u.coordinate(values[u.name]) for u in unknowns]])
            try:
                _, found = fit_with_choices(given, choices, start, search=False, on_progress=self._say)
            except FitError as error:
                raise WorkspaceError(str(error)) from None
            self._kept = of, found
        return self._kept[1]

    def _steps_per_sample(self, campaign: Campaign, run: BenchRun) -> int:
        """The time steps of a run per sample at which its error is far below the noise, with the model as given."""
        kept = self._steps.get(run.name)
        if kept is None or kept[0] is not run:
            model = MeasurementModel(campaign, campaign.machine, (), (run,))
            kept = self._steps[run.name] = run, choose_time_resolution(model, np.zeros(0)).fine
        return kept[1]
