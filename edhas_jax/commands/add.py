"""The command `edhas add`."""

import math
from pathlib import Path

from edhas_jax.commands.arguments import (
    add_output_file,
    add_output_options,
    add_own_code,
    own_code,
    require_own_code,
)
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("add", help="fit a campaign's model with more effects and write its configuration")
    parser.add_argument("effect", nargs="+", metavar="EFFECT", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--campaign", type=Path, required=True, help="folder of the campaign")
    add_output_file(parser, "configuration to write (default: NAME_EFFECT.yaml)")
    add_own_code(parser, effects=False)
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Fit a campaign's model with one more effect, or with several one after the other; write the configuration.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the file exists or cannot be written.
    """
    from edhas_jax.config.run_folder import ResultFileError, report_write_errors
    from edhas_jax.core.literal_text import file_name
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.core.units import format_quantity
    from edhas_jax.diagnosis.calibration.fit_problem import FitError
    from edhas_jax.diagnosis.chosen_effects import fit_with_effects, save_model
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError, Use
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign

    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    effects = [load_effect(spec, trust=[spec]) for spec in options.effect]
    path = options.out or Path(f"{file_name(campaign.name)}_{'+'.join(effect.id for effect in effects)}.yaml")
    if path.exists() and not options.overwrite:
        raise ResultFileError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    out = console(options)
    with WorkProgress(options, "checking the data") as progress:
        campaign = checked_campaign(campaign)
        try:
            models = fit_with_effects(campaign, effects, progress)
        except FitError as error:
            raise CampaignError(str(error)) from None
    with report_write_errors(path):
        save_model(campaign, models[-1], path)
    rows, records = [], []
    for model in models:
        name = f"with {model.name}" if model.effects else model.name
        rms = [model.evaluated.rms_over_noise(use) for use in (Use.FIT, Use.HOLDOUT)]
        rows.append((name, *(f"{value:.3f}" if math.isfinite(value) else "none is held out" for value in rms)))
        records.append({"model": name, "fitted_runs": rms[0], "held_out_runs": rms[1]})
    columns = "model", "fitted runs", "held-out runs"
    errors = SummaryTable.of("residual_over_noise", columns, rows, records, "residual over noise")
    rows, records = [], []
    for name, found in models[-1].as_json()["parameters"].items():
        value, error, unit = found["value"], found["std"], found["unit"]
        rows.append((name, format_quantity(value, unit), f"± {format_quantity(error, unit)}"))
        records.append({"name": name, "value": value, "error": error, "unit": unit})
    sizes = SummaryTable.of("estimates", ("name", "value", "standard error"), rows, records)
    summary = Summary(f"{campaign.name}: fitted with {models[-1].name}", (errors, sizes))
    follow = f"compare {quoted(options.campaign)} --model {quoted(path)}"
    finish(options, out, summary, next_command=follow, written=str(path))
