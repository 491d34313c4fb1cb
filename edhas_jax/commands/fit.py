"""The command `edhas fit`."""

import time
from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
    add_output_folder,
    add_own_code,
    own_code,
    require_own_code,
    whole_number,
)
from edhas_jax.commands.console import console, file_names, print_data_check, table
from edhas_jax.commands.interruption import STATUS_INTERRUPTED, terminate_as_interrupt

FILES = "report.html", "fit.json", "config.yaml"  # that the command writes


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("fit", help="calibrate the uncertain parameters of a campaign's machine")
    add_campaign_folder(parser)
    add_output_folder(parser, "fits")
    parser.add_argument("--starts", type=whole_number(1, 100), default=4, help="points to start from (default: 4)")
    parser.add_argument(
        "--profile", action="append", default=[], metavar="NAME",
        help="also the likelihood along this parameter, all others fitted anew; may be given several times",
    )  # fmt: skip
    add_own_code(parser, effects=False)
    parser.set_defaults(command=run)


def run(options) -> int | None:
    """Calibrate the uncertain parameters of a campaign's machine, write a folder, print the estimates.

    Returns:
        The exit status of an interrupted command, else None.

    Raises:
        CampaignError: a profile is asked of a parameter that is not uncertain, or the fit fails.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors, unused_folder
    from edhas_jax.core.optional_parts import OptionalParts
    from edhas_jax.diagnosis.calibration.confounding import assumed_parameters
    from edhas_jax.diagnosis.calibration.fit import fit
    from edhas_jax.diagnosis.calibration.fit_problem import FitError, FitProblem
    from edhas_jax.diagnosis.calibration.report import fit_report
    from edhas_jax.diagnosis.calibration.result import Calibration, campaign_residuals, save_calibration
    from edhas_jax.diagnosis.calibration.uncertainty import fit_each_run, profile_likelihood
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.measurements.instruments import Instruments
    from edhas_jax.measurements.unknown_parameters import uncertain_unknowns

    began = time.perf_counter()
    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    with console().status("checking the data"):
        campaign = checked_campaign(campaign)
    folder = options.out or unused_folder(Path("fits"), campaign.name)
    files = ResultFiles(folder, options.overwrite, FILES)
    unknowns = uncertain_unknowns(campaign)
    uncertain = [u.name for u in unknowns]
    for name in options.profile:
        if name not in uncertain:
            raise CampaignError(f"--profile {name}: not an uncertain parameter; these are: {', '.join(uncertain)}")
    out = console()
    print_data_check(out, campaign)
    optional, drift, profiles, assumed, status_code = OptionalParts(), None, [], [], None
    with terminate_as_interrupt(), out.status("reading") as status:
        problem = FitProblem(campaign, campaign.machine, unknowns)
        try:
            calibrated = fit(problem, starts=options.starts, on_progress=status.update)
        except FitError as error:
            raise CampaignError(str(error)) from None
        status.update("residuals of all runs")
        fine = calibrated.resolution.fine
        before = campaign_residuals(campaign, campaign.machine, Instruments(), fine)
        after = campaign_residuals(campaign, calibrated.machine, calibrated.instruments, fine)
        result = Calibration(calibrated, None, (), before, after, time.perf_counter() - began)
        with report_write_errors(folder):
            files.begin()
            save_calibration(result, folder)
        try:
            drift = optional.attempt(
                "The fit of each run alone",
                lambda: fit_each_run(calibrated, lambda step: status.update(f"each run alone, {step}")),
            )
            assumed = (
                optional.attempt("The parameters taken as known", lambda: assumed_parameters(calibrated, status.update))
                or []
            )
            for name in options.profile:
                what = f"profile of {name}, "
                profile = optional.attempt(
                    f"The profile of {name}",
                    lambda name=name, what=what: profile_likelihood(
                        calibrated, name, lambda step: status.update(what + step)
                    ),
                )
                profiles += [] if profile is None else [profile]
        except KeyboardInterrupt:
            optional.failures.append("Interrupted: the results so far are written.")
            status_code = STATUS_INTERRUPTED
        seconds = time.perf_counter() - began
        result = Calibration(calibrated, drift, tuple(profiles), before, after, seconds, tuple(assumed))
        with report_write_errors(folder):
            save_calibration(result, folder, optional.failures)
            text = optional.attempt("report.html", lambda: fit_report(result))
            if text is not None:
                (folder / "report.html").write_text(text, encoding="utf-8")
            files.finish()
    out.print(errors_table(result))
    out.print(estimates_table(result))
    for number, sentence in enumerate(result.findings(), 1):
        out.print(f"{number}. {sentence}", soft_wrap=True)
    for sentence in optional.failures:
        out.print(sentence, soft_wrap=True)
    out.print(f"{seconds:.0f} s; written to {folder}: " + file_names(folder), soft_wrap=True)
    return status_code


def errors_table(result):
    """Residual over noise of each signal as a rich table: before and after, on the fitted and the held-out runs."""
    columns = [f"{state}, {use}" for use in ("fitted", "held out") for state in ("before", "calibrated")]
    rows = table("residual over noise", "signal", *columns)
    errors = result.rms_residuals()
    columns = [errors[state][use] for use in ("fit", "holdout") for state in ("before", "calibrated")]
    for name in columns[0]:
        rows.add_row(name, *(f"{column[name]:.2f}" if name in column else "" for column in columns))
    return rows


def estimates_table(result):
    """The estimates as a rich table: prior mean, estimate, interval, pull and error in prior standard deviations."""
    from edhas_jax.core.units import format_quantity

    fit = result.fit
    rows = table("unknowns", "name", "prior mean", "value", "95 % interval", "pull, prior σ", "error, prior σ")
    for u, x, std in zip(fit.problem.unknowns, fit.x, fit.std, strict=True):
        low, high = (format_quantity(v, u.unit) for v in fit.interval(u.name))
        rows.add_row(u.name, format_quantity(u.centre, u.unit), format_quantity(fit.values[u.name], u.unit),
                       f"{low} … {high}", f"{x:+.2f}", f"{std:.3f}")  # fmt: skip
    return rows
