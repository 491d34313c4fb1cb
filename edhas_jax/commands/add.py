"""The command `edhas add`."""

from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser(
        "add", help="add effects to a campaign's machine, and fit it: the campaign and the model with them"
    )
    arguments.add_campaign_folder(parser)
    parser.add_argument(
        "effect", nargs="+", metavar="EFFECT",
        help="id of an effect, FILE.py:Class, or the folder of a diagnosis for the effects that it names",
    )  # fmt: skip
    arguments.add_output_folder(parser, "added")
    arguments.add_own_code(parser, effects=False)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Fit a campaign's model with more effects, one after the other; write the model, and the campaign with them.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the folder exists or cannot be written, or one of a diagnosis names no effect.
    """
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.tasks.add import AddResult, add

    campaign = read_campaign(options.campaign, arguments.own_code(options))
    arguments.require_own_code(options, campaign.machine)
    specs = [spec for given in options.effect for spec in _named(given)]
    effects = [load_effect(spec, trust=[spec]) for spec in specs]
    folder = arguments.output_folder(options, "added", f"{campaign.name}_{'+'.join(effect.id for effect in effects)}")
    AddResult.reserve(folder, options.overwrite)
    out = console(options)
    with WorkProgress(options, "checking the data") as progress:
        result = add(campaign, effects, on_progress=progress)
    result.save(folder, options.overwrite)
    finish(options, out, result.summary(), folder, f"diagnose {quoted(folder)}{arguments.own_words(options)}")


def _named(given: str) -> list[str]:
    """The effects that an argument names: those of a diagnosis, or itself.

    Raises:
        ResultFileError: a diagnosis is damaged or names no effect.
    """
    from edhas_jax.config.run_folder import ResultFileError
    from edhas_jax.tasks.result import open_result

    if not (Path(given) / "diagnosis.json").is_file():
        return [given]
    if named := open_result(given).numbers.get("effects"):
        return named
    raise ResultFileError(f"{given}: this diagnosis names no effect")
