"""The command `edhas add`."""

from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
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
    add_campaign_folder(parser)
    parser.add_argument("effect", nargs="+", metavar="EFFECT", help="id of an effect, or FILE.py:Class")
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
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.tasks.add import add

    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    effects = [load_effect(spec, trust=[spec]) for spec in options.effect]
    path = options.out or Path(f"{file_name(campaign.name)}_{'+'.join(effect.id for effect in effects)}.yaml")
    if path.exists() and not options.overwrite:
        raise ResultFileError(f"{path}: exists already; nothing was written. Name another file or add --overwrite")
    out = console(options)
    with WorkProgress(options, "checking the data") as progress:
        result = add(campaign, effects, on_progress=progress)
    with report_write_errors(path):
        result.save_model(path)
    follow = f"compare {quoted(options.campaign)} --model {quoted(path)}"
    finish(options, out, result.summary(), next_command=follow, written=str(path))
