"""Add: fit a campaign's model with effects that the engineer has chosen."""

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.run_folder import write_json
from edhas_jax.core.literal_text import figure_text
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.core.structs import Parameter
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import estimate_text, exact_quantity, format_quantity, to_si
from edhas_jax.diagnosis.search.chosen_effects import USES, ChosenModel, fit_with_effects, save_model
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.loading import effect_spec, load_effect
from edhas_jax.machine.parameters import find_parameter, short_names
from edhas_jax.measurements.campaign import CAMPAIGN_FILE, Campaign, CampaignError, Use
from edhas_jax.measurements.campaign_reader import as_campaign
from edhas_jax.measurements.campaign_with_effects import description_with_effects
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.fitted_model import ERROR_BY_RUN, IS_CORRECTED, OF_RUNS
from edhas_jax.measurements.unknown_parameters import ParameterScale
from edhas_jax.tasks.result import Result, save_figure

CONFIG_FILE, DATA_FILE, FIGURE_FILE = "config.yaml", "result.json", "errors.png"
MODEL_REMARK = "# with {} in its machine, the sizes as `edhas add` has fitted them\n"


@dataclasses.dataclass(frozen=True, repr=False)
class AddResult(Result):
    """The model of a campaign's machine, calibrated, and after each effect that was added.

    Attributes:
        campaign: the measurements.
        models: the model without any added effect, and after each of them.
    """

    campaign: Campaign
    models: tuple[ChosenModel, ...]
    files = (CAMPAIGN_FILE, CONFIG_FILE, DATA_FILE, FIGURE_FILE)

    @property
    def machine(self):
        """The machine with all effects, everything fitted."""
        return self.models[-1].evaluated.fit.machine

    @property
    def names(self) -> list[str]:
        """The names of the models."""
        return [f"with {model.name}" if model.effects else model.name for model in self.models]

    def errors(self, use: Use) -> list[float]:
        """Rms of residual over noise of each model over the runs of one use; NaN where there are none."""
        return [model.evaluated.rms_over_noise(use) for model in self.models]

    def summary(self) -> Summary:
        """See `Result.summary`; that the model without an effect is as good is said first."""
        errors = list(zip(*(self.errors(use) for use in USES), strict=True))
        rows, records = [], []
        for name, values in zip(self.names, errors, strict=True):
            rows.append((name, *(f"{v:.3f}" if math.isfinite(v) else "none is held out" for v in values)))
            records.append({"model": name, "fitted_runs": values[0], "held_out_runs": values[1]})
        columns = "model", *USES.values()
        table = SummaryTable.of("residual_over_noise", columns, rows, records, "residual over noise")
        needless = [Toned(m.needs_no_effect, Tone.CAUTION) for m in self.models if m.needs_no_effect]
        parts = [*needless, table, self._sizes()]
        if self._changes_campaign:
            names = " and ".join(candidate.id for candidate in self.models[-1].effects)
            parts.append(
                f"{CAMPAIGN_FILE} is the campaign with {names} in its machine; the measurements stay where they are. "
                f"{CONFIG_FILE} is the machine with everything fitted."
            )
        return Summary(f"{self.campaign.name}: fitted with {self.models[-1].name}", tuple(parts))

    @property
    def _changes_campaign(self) -> bool:
        """Whether there is a description of the campaign, and an effect to be added to it."""
        return self.campaign.file is not None and bool(self.models[-1].effects)

    def campaign_text(self, folder: Path) -> str:
        """The description of the campaign with the effects in its machine, as it reads in a folder.

        The sizes are the fitted ones, as uncertain as they were before the fit, so that a fit of this campaign uses the
        measurements once. Everything else is as the campaign states it.
        """
        parameters, uncertain = {}, {}
        estimates = self.models[-1].as_json()["parameters"]
        for candidate in self.models[-1].effects:
            for u in candidate.unknowns(self.campaign):
                p, path = find_parameter(self.machine, u.name)
                name, value = short_names(self.machine)[path, p.name], estimates[u.name]["value"]
                is_relative = u.scale is ParameterScale.LOGARITHMIC and value > 0.0
                size = u.spread if is_relative or u.scale is not ParameterScale.LOGARITHMIC else u.spread * u.centre
                spread = f"relative: {size:.3g}" if is_relative else f"absolute: {format_quantity(size, p.unit)}"
                parameters[name], uncertain[name] = _short_quantity(value, p), f"{{{spread}}}"
        specs = [effect_spec(candidate.kind) for candidate in self.models[-1].effects]
        text = description_with_effects(self.campaign.file, folder, specs, parameters, uncertain)
        return MODEL_REMARK.format(" and ".join(candidate.id for candidate in self.models[-1].effects)) + text

    def _sizes(self) -> SummaryTable:
        rows, records = [], []
        for name, found in self.models[-1].as_json()["parameters"].items():
            value, error, unit, limit = found["value"], found["std"], found["unit"], found.get("limit")
            rows.append((name, estimate_text(value, error, unit, limit)))
            records.append({"name": name, "value": value, "error": error, "unit": unit, "limit": limit})
        return SummaryTable.of("estimates", ("name", "size ± standard error"), rows, records)

    def plot(self):
        """Plot residual over noise (rms) of every model, on fitted and held-out runs, as a matplotlib figure."""
        from edhas_jax.core.figure import Figure

        figure = Figure(figsize=(7.0, 1.3 + 0.5 * len(self.models)), layout="constrained")
        axes, rows = figure.subplots(), range(len(self.models))
        axes.axvline(1.0, color=GREY, lw=1.0, ls="--", label="noise")
        for (use, label), colour, marker in zip(USES.items(), COLOURS, "os", strict=False):
            axes.plot(self.errors(use), rows, marker, ms=7, color=colour, label=label)
        axes.set_xscale("log")
        axes.set_yticks(rows, [figure_text(name) for name in self.names], color=INK)
        axes.set_ylim(len(self.models) - 0.5, -0.5)
        axes.set_xlabel("rms of the residual over noise", color=INK)
        axes.grid(axis="x", which="both", lw=0.4, alpha=0.5)
        axes.legend(frameon=False, fontsize=9)
        return figure

    def _of_runs(self) -> dict[str, Any]:
        """What the runs have of their own in the last model, and its residual over noise by run and signal."""
        row = self.models[-1].as_json()
        return {name: row[name] for name in (OF_RUNS, ERROR_BY_RUN, IS_CORRECTED)}

    def save_model(self, path: Path | str) -> None:
        """Write the machine with all effects as a configuration.

        What runs have of their own and their errors are written beside it, `model.runs.json` beside `model.yaml`.

        Raises:
            OSError: the file cannot be written.
        """
        save_model(self.models[-1], Path(path))
        write_json(Path(path).with_suffix(".runs.json"), self._of_runs())

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        if self._changes_campaign:
            (folder / CAMPAIGN_FILE).write_text(self.campaign_text(folder), encoding="utf-8")
        save_model(self.models[-1], folder / CONFIG_FILE)
        rows = [model.as_json() for model in self.models]
        write_json(folder / DATA_FILE, {"models": rows} | self._of_runs())
        save_figure(self.plot(), folder / FIGURE_FILE)
        return ()


def _short_quantity(value: float, p: Parameter) -> str:
    """A value (SI) as text with four digits, or with all of them where rounding would leave the span."""
    text = format_quantity(value, p.unit)
    return text if p.span[0] <= to_si(text, p.unit) <= p.span[1] else exact_quantity(value, p.unit)


def add(
    campaign: Campaign | Path | str,
    effects: Iterable[type[Effect] | str],
    trust: Trust = (),
    on_progress: Callable[[str], None] | None = None,
) -> AddResult:
    """Fit a campaign's model without, with the first, with the first two, … of some effects.

    Args:
        campaign: a campaign or its folder.
        effects: classes of effects, ids of those of the library, or "FILE.py:Class" for one of your own, in the order
            in which they are added.
        trust: Python files of your own that may run if the campaign names them; those in `effects` may run anyway.
        on_progress: called with a sentence on the work at hand.

    Returns:
        The calibrated model, and the model after each effect, with their errors.

    Raises:
        CampaignError: the campaign is wrong, the fit fails, or the machine cannot have an effect.
        EffectError: an effect is unknown or wrong.
    """
    kinds = [load_effect(kind, trust=[kind]) if isinstance(kind, str) else kind for kind in effects]
    report = on_progress or (lambda sentence: None)
    campaign = as_campaign(campaign, trust)
    report("checking the data")
    campaign = checked_campaign(campaign)
    try:
        return AddResult(campaign, tuple(fit_with_effects(campaign, kinds, report)))
    except FitError as error:
        raise CampaignError(str(error)) from None
