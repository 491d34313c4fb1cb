"""The command `edhas plan`."""

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, print_data_check, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("plan", help="before any test: what a campaign's runs and sensors could reveal")
    arguments.add_campaign_folder(parser, "folder of the campaign; its runs need no files yet")
    parser.add_argument("--rate", default="5 kHz", help="sampling of runs without a file (default: 5 kHz)")
    arguments.add_user_effects(parser, "FILE.py:Class", "also consider this effect of your own; may be given again")
    arguments.add_output_folder(parser, "plans")
    arguments.add_own_code(parser, effects=False)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Predict which effects a planned campaign can detect, write a folder, print the most useful next run.

    Raises:
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import report_write_errors
    from edhas_jax.core.units import to_si
    from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.tasks.plan import PlanResult, plan

    campaign = read_planned_campaign(options.campaign, to_si(options.rate, "Hz", "5 kHz"), arguments.own_code(options))
    arguments.require_own_code(options, campaign.machine)
    folder = arguments.output_folder(options, "plans", campaign.name)
    files = PlanResult.reserve(folder, options.overwrite)
    out = console(options)
    with WorkProgress(options, "checking the data"):
        campaign = checked_campaign(campaign)
    print_data_check(out, campaign)
    with WorkProgress(options, "compiling") as progress:
        result = plan(campaign, effects=options.effects, on_progress=progress)
        with report_write_errors(folder):
            files.begin()
            failures = result.write_files(folder)
            result.write_summary(folder)
            files.finish()
    for sentence in failures:
        out.print(sentence, soft_wrap=True)
    finish(options, out, result.summary(), folder, f"campaign check {quoted(options.campaign)}")
