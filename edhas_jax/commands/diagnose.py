"""The command `edhas diagnose`."""

import math
import re
import sys
from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
    add_output_folder,
    add_own_code,
    add_user_effects,
    own_code,
    require_own_code,
)
from edhas_jax.commands.console import console, file_names, print_data_check, save_figure, table
from edhas_jax.commands.interruption import STATUS_INTERRUPTED, terminate_as_interrupt

DEFAULT_PARENT = Path("diagnoses")
MAX_BENCH_ROWS = 10  # deviations of the bench that are printed; the report lists all
FILES = "report.html", "diagnosis.json", "diagnosis.png", "config.yaml"  # that the command writes


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("diagnose", help="what is missing in the model of a campaign's machine")
    add_campaign_folder(parser)
    add_output_folder(parser, "diagnoses")
    add_user_effects(parser, "FILE.py:CLASS", "also consider an effect of your own; may be given several times")
    add_own_code(parser, effects=False)
    parser.set_defaults(command=run)


def run(options) -> int | None:
    """Find the effects that a campaign's model lacks, write a folder, print the verdict.

    Returns:
        The exit status of an interrupted command, else None.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors
    from edhas_jax.core.optional_parts import OptionalParts
    from edhas_jax.diagnosis.calibration.fit_problem import FitError
    from edhas_jax.diagnosis.report.result_file import save_diagnosis
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, Checkpoint, diagnosis_identity
    from edhas_jax.diagnosis.search.forward_selection import diagnose
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign import CampaignError
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign

    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    with console().status("checking the data"):
        campaign = checked_campaign(campaign)
    user_effects = [load_effect(spec, trust=[spec]) for spec in options.effects]
    identity = diagnosis_identity(campaign, user_effects)
    out = console()
    folder, sentences = _choose_folder(options, campaign.name, identity)
    files = ResultFiles(folder, True, FILES)
    for sentence in sentences:
        out.print(sentence, soft_wrap=True)
    print_data_check(out, campaign)
    checkpoint, optional, status_code = Checkpoint(folder / CHECKPOINT_FOLDER, identity), OptionalParts(), None
    with terminate_as_interrupt(), out.status("reading") as status:

        def say(sentence: str) -> None:
            status.update(sentence)

        try:
            diagnosis = diagnose(campaign, more=user_effects, on_progress=say, checkpoint=checkpoint)
        except FitError as error:
            raise CampaignError(str(error)) from None
        except KeyboardInterrupt:
            if not checkpoint.kept:
                raise
            print(f"edhas: interrupted; finished stages of the search ({checkpoint.kept}) are kept in {folder}; "
                  "the same command goes on from them", file=sys.stderr)  # fmt: skip
            return STATUS_INTERRUPTED
        optional.failures += checkpoint.failures
        with report_write_errors(folder):
            files.begin()
            save_diagnosis(diagnosis, folder)
        experiment = None
        try:
            experiment = _add_optional_parts(diagnosis, folder, optional, say)
            checkpoint.remove()
        except KeyboardInterrupt:
            optional.failures.append("Interrupted: the result is written, but not all of its pictures; "
                                     "the same command makes them.")  # fmt: skip
            status_code = STATUS_INTERRUPTED
        with report_write_errors(folder):
            save_diagnosis(diagnosis, folder, None if experiment is None else experiment.as_json(), optional.failures)
            files.finish()
    _print_result(out, diagnosis, experiment, optional.failures, folder)
    return status_code


def _choose_folder(options, name: str, identity: dict[str, str]) -> tuple[Path, list[str]]:
    """The folder to write, that of the same unfinished diagnosis if there is one, and sentences about the choice.

    Raises:
        ResultFileError: the folder of `--out` exists and is not that of an unfinished diagnosis.
    """
    from edhas_jax.config.run_folder import require_new_folder, unused_folder
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, stored_identity

    if options.out:
        folder, places = options.out, [options.out]
    else:
        folder = unused_folder(DEFAULT_PARENT, name)
        places = sorted(p for p in DEFAULT_PARENT.glob("*") if _without_number(p.name) == _without_number(folder.name))
    sentences, unfinished = [], {p: stored_identity(p / CHECKPOINT_FOLDER) for p in places}
    for place, stored in unfinished.items():
        if stored == identity:
            return place, [f"Going on from the finished rounds in {place}."]
        if stored is not None:
            changed = " and ".join(what for what in identity if stored.get(what) != identity[what])
            sentences.append(
                f"The finished rounds in {place} are not used, because they were computed from other inputs: "
                f"{changed} changed."
            )
    if unfinished.get(folder) is None:
        require_new_folder(folder, options.overwrite)
    return folder, sentences


def _without_number(name: str) -> str:
    """The name of a folder without the number that distinguishes it from earlier ones."""
    return re.sub(r"-\d+$", "", name)


def _add_optional_parts(diagnosis, folder: Path, optional, say):
    """Write report, next experiment and pictures; each may fail alone. Returns the experiment, if there is one."""
    from edhas_jax.diagnosis.planning.next_experiment import next_experiment
    from edhas_jax.diagnosis.report.overview_figure import draw_overview
    from edhas_jax.diagnosis.report.report import write_report

    path = folder / "report.html"
    say("writing the report")
    optional.attempt("The report", lambda: write_report(diagnosis, path, pictures=False))
    say("looking for the most informative next run")
    experiment = optional.attempt("The next experiment", lambda: next_experiment(diagnosis))
    say("drawing the pictures")
    optional.attempt("diagnosis.png", lambda: save_figure(draw_overview(diagnosis), folder / "diagnosis.png"))
    failed = optional.attempt(
        "The report with pictures", lambda: write_report(diagnosis, path, experiment, optional.failures)
    )
    optional.failures += failed or []
    return experiment


def _print_result(out, diagnosis, experiment, failures: list[str], folder: Path) -> None:
    """Print tables, conclusions, what failed, and where the files are."""
    from edhas_jax.diagnosis.search.conclusions import bench_rows, conclusions
    from edhas_jax.measurements.checks.data_summary import data_sentences

    if deviations := bench_rows(diagnosis):
        rows = table("what the bench did", "what", "run", "deviation", "accuracy")
        for row in deviations[:MAX_BENCH_ROWS]:
            rows.add_row(*row)
        out.print(rows)
    out.print(candidates_table(diagnosis))
    out.print(errors_table(diagnosis))
    for sentence in data_sentences(diagnosis.campaign, conclusions(diagnosis)):
        out.print(sentence, soft_wrap=True)
    if experiment is not None:
        out.print(experiment.sentence, soft_wrap=True)
    for sentence in failures:
        out.print(sentence, soft_wrap=True)
    out.print(f"{diagnosis.seconds:.0f} s; written to {folder}: {file_names(folder)}", soft_wrap=True)


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
        new_runs = f"{rms:.3f}" if math.isfinite(rms) else "none is held out"
        rows.add_row(candidate.name, candidate.location, ", ".join(sizes), f"{p:.3f}", new_runs)
    return rows


def errors_table(diagnosis):
    """Residual over noise of each signal as a rich table: before, calibrated and after, fitted and held-out runs."""
    errors = diagnosis.errors()
    rows = table("residual over noise", "signal", *(f"{s}, {u}" for u in ("fitted", "held out") for s in errors))
    columns = [errors[state][use] for use in ("fit", "holdout") for state in errors]
    for name in columns[0]:
        rows.add_row(name, *(f"{column[name]:.2f}" if name in column else "" for column in columns))
    return rows
