"""The command `edhas compare`."""

from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, print_data_check, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("compare", help="the model beside the measurements, and where it fails")
    arguments.add_campaign_folder(parser)
    parser.add_argument("--model", type=Path, help="configuration of the model (default: the campaign's own)")
    parser.add_argument(
        "--replay", choices=("set_point", "voltage", "current", "piston_position"), default="set_point",
        help="drive the model with this measured signal, so that what lies behind it is judged alone",
    )  # fmt: skip
    arguments.add_output_folder(parser, "comparisons")
    arguments.add_own_code(parser)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Simulate the runs of a campaign, write a report, print the residuals and their patterns."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.replay import Replay
    from edhas_jax.tasks.compare import ComparisonResult, compare

    trust = arguments.own_code(options)
    campaign = read_campaign(options.campaign, trust)
    models = [read_config(options.model, trust=trust).machine] if options.model else []
    arguments.require_own_code(options, campaign.machine, *models)
    folder = arguments.output_folder(options, "comparisons", campaign.name)
    ComparisonResult.reserve(folder, options.overwrite)
    out = console(options)
    with WorkProgress(options) as progress:
        replay = Replay(options.replay)
        result = compare(campaign, options.model, replay=replay, trust=trust, on_progress=progress)
        progress("looking for patterns")
        patterns = result.patterns
        progress("drawing")
        result.save(folder, options.overwrite)
    print_data_check(out, result.campaign, result.remarks)
    follow = "diagnose" if patterns else "fit"
    finish(options, out, result.summary(), folder, f"{follow} {quoted(options.campaign)}{arguments.own_words(options)}")
