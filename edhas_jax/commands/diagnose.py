"""The command `edhas diagnose`."""

from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
    add_output_folder,
    add_own_code,
    add_user_effects,
    own_code,
)
from edhas_jax.commands.console import console, file_names, print_remarks, save_figure, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("diagnose", help="what is missing in the model of a campaign's machine")
    add_campaign_folder(parser)
    add_output_folder(parser, "diagnoses")
    add_user_effects(parser, "FILE.py:CLASS", "also consider an effect of your own; may be given several times")
    add_own_code(parser, effects=False)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Find the effects that a campaign's model lacks, write a folder, print the verdict.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the folder exists or cannot be written.
    """
    from rich.markup import escape

    from edhas_jax.config.run_folder import report_write_errors, require_new_folder, unused_folder
    from edhas_jax.diagnosis.calibration.fit import FitError
    from edhas_jax.diagnosis.planning.next_experiment import next_experiment
    from edhas_jax.diagnosis.report.overview_figure import draw_overview
    from edhas_jax.diagnosis.report.report import write_report
    from edhas_jax.diagnosis.report.result_file import save_diagnosis
    from edhas_jax.diagnosis.search.forward_selection import diagnose
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.measurements.campaign_reader import read_campaign

    campaign = read_campaign(options.campaign, own_code(options))
    folder = options.out or unused_folder(Path("diagnoses"), campaign.name)
    require_new_folder(folder, options.overwrite)
    user_effects = [load_effect(spec, trust=[spec]) for spec in options.effects]
    out = console()
    print_remarks(out, campaign.remarks)
    with out.status("reading") as status:
        try:
            diagnosis = diagnose(
                campaign, more=user_effects, on_progress=lambda sentence: status.update(escape(sentence))
            )
        except FitError as error:
            raise CampaignError(str(error)) from None
        status.update("looking for the most informative next run")
        experiment = next_experiment(diagnosis)
        status.update("writing the report")
        with report_write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
            save_diagnosis(diagnosis, folder, None if experiment is None else experiment.as_json())
            write_report(diagnosis, folder / "report.html", experiment)
            save_figure(draw_overview(diagnosis), folder / "diagnosis.png")
    out.print(candidates_table(diagnosis))
    out.print(errors_table(diagnosis))
    for sentence in diagnosis.sentences():
        out.print(escape(sentence), soft_wrap=True)
    if experiment is not None:
        out.print(escape(experiment.sentence), soft_wrap=True)
    out.print(f"{diagnosis.seconds:.0f} s; written to {folder}: {file_names(folder)}")


def candidates_table(diagnosis):
    """The candidates that were fitted, as a rich table: parameters, probability, residual on the held-out runs."""
    from edhas_jax.core.units import format_quantity
    from edhas_jax.measurements.campaign import Use

    rows = table("candidates", "effect", "where", "size", "probability", "new runs, residual over noise")
    for candidate, p, trial in diagnosis.ranked_candidates():
        if trial is None or trial.evaluated is None:
            continue
        fitted = diagnosis.after if candidate in [t.candidate for t in diagnosis.accepted] else trial.evaluated
        own = candidate.own_unknowns(fitted.fit.problem.unknowns)
        sizes = [f"{name} {format_quantity(fitted.fit.values[u.name], u.unit)}" for name, u in own.items()]
        rms = fitted.rms_over_noise(Use.HOLDOUT)
        rows.add_row(candidate.name, candidate.location, ", ".join(sizes), f"{p:.3f}", f"{rms:.3f}")
    return rows


def errors_table(diagnosis):
    """Residual over noise of each signal as a rich table: before, calibrated and after, fitted and held-out runs."""
    errors = diagnosis.errors()
    rows = table("residual over noise", "signal", *(f"{s}, {u}" for u in ("fitted", "held out") for s in errors))
    columns = [errors[state][use] for use in ("fit", "holdout") for state in errors]
    for name in columns[0]:
        rows.add_row(name, *(f"{column[name]:.2f}" if name in column else "" for column in columns))
    return rows
