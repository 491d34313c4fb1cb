"""The command `edhas add`."""

import math
from pathlib import Path

from edhas_jax.commands.arguments import add_output_file, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("add", help="fit a campaign's model with more effects and write its configuration")
    parser.add_argument("effect", nargs="+", metavar="EFFECT", help="id of an effect, or FILE.py:Class")
    parser.add_argument("--campaign", type=Path, required=True, help="folder of the campaign")
    add_output_file(parser, "configuration to write (default: NAME_EFFECT.yaml)")
    add_own_code(parser, effects=False)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Fit a campaign's model with one more effect, or with several one after the other; write the configuration.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the file exists or cannot be written.
    """
    from edhas_jax.config.run_folder import ResultFileError, report_write_errors
    from edhas_jax.core.literal_text import file_name
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
    out = console()
    with out.status("checking the data") as status:
        campaign = checked_campaign(campaign)
        try:
            models = fit_with_effects(campaign, effects, lambda sentence: status.update(sentence))
        except FitError as error:
            raise CampaignError(str(error)) from None
    with report_write_errors(path):
        save_model(campaign, models[-1], path)
    rows = table("residual over noise", "model", "fitted runs", "held-out runs")
    for model in models:
        rms = [model.evaluated.rms_over_noise(use) for use in (Use.FIT, Use.HOLDOUT)]
        name = f"with {model.name}" if model.effects else model.name
        rows.add_row(name, *(f"{value:.3f}" if math.isfinite(value) else "none is held out" for value in rms))
    out.print(rows)
    for name, found in models[-1].as_json()["parameters"].items():
        size, error = (format_quantity(found[key], found["unit"]) for key in ("value", "std"))
        out.print(f"{name}: {size} ± {error}")
    out.print(f"written: {path}; compare it with `edhas compare {options.campaign} --model {path}`", soft_wrap=True)
