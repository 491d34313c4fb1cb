"""The command `edhas fit`."""

import dataclasses
from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, print_data_check, quoted
from edhas_jax.commands.progress import WorkProgress

STATUS_NOT_CONVERGED = 4


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser(
        "fit", help="calibrate the uncertain parameters of a campaign's machine",
        epilog=f"The exit status is {STATUS_NOT_CONVERGED} if the fit has not converged. Ctrl-C ends the search and "
        "keeps the best values so far.",
    )  # fmt: skip
    arguments.add_campaign_folder(parser)
    arguments.add_output_folder(parser, "fits")
    whole = arguments.whole_number(1, 100)
    parser.add_argument("--starts", type=whole, default=4, help="points to start from (default: 4)")
    parser.add_argument(
        "--profile", action="append", default=[], metavar="NAME",
        help="also the likelihood along this parameter, all others fitted anew; may be given several times",
    )  # fmt: skip
    parser.add_argument(
        "--choices", type=Path, metavar="FILE.yaml",
        help="free and fixed parameters, limits, priors, runs, signals and time windows, where they differ from the "
        "campaign",
    )  # fmt: skip
    arguments.add_own_code(parser, effects=False)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> int:
    """Calibrate the uncertain parameters of a campaign's machine, write a folder, print the estimates.

    Returns:
        The exit status: 0, or 4 if the fit has not converged.

    Raises:
        CampaignError: the choices are wrong, a profile is asked of a parameter that is not free, or the fit fails.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import report_write_errors
    from edhas_jax.inference.fit.calibration import save_calibration
    from edhas_jax.inference.fit.fit_choices_reader import read_choices
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.tasks.fit import FitResult, fit, require_uncertain

    campaign = read_campaign(options.campaign, arguments.own_code(options))
    arguments.require_own_code(options, campaign.machine)
    out = console(options)
    with WorkProgress(options, "checking the data"):
        campaign = checked_campaign(campaign)
    folder = arguments.output_folder(options, "fits", campaign.name)
    files = FitResult.reserve(folder, options.overwrite)
    choices = read_choices(options.choices, campaign)
    require_uncertain(options.profile, [u.name for u in choices.unknowns(choices.applied(campaign))])
    print_data_check(out, campaign)

    def keep(estimates: FitResult) -> None:
        """Write what the checks cannot change, before they begin."""
        with report_write_errors(folder):
            files.begin()
            save_calibration(estimates, folder)

    with WorkProgress(options, "calibrating") as progress:
        result = fit(
            campaign, options.starts, options.profile, on_progress=progress, keep=keep, choices=choices,
            on_step=lambda step: progress.numbers(dataclasses.asdict(step)),
        )  # fmt: skip
        progress("writing the report")
        with report_write_errors(folder):
            failures = result.write_files(folder)
            result.write_summary(folder)
            files.finish()
    for sentence in (f for f in failures if f not in result.failures):
        out.print(sentence, soft_wrap=True)
    finish(options, out, result.summary(), folder, f"diagnose {quoted(options.campaign)}{arguments.own_words(options)}")
    return 0 if result.fit.converged else STATUS_NOT_CONVERGED
