"""The command `edhas diagnose`."""

import re
from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, print_data_check, quoted
from edhas_jax.commands.progress import WorkProgress

DEFAULT_PARENT = Path("diagnoses")


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("diagnose", help="what is missing in the model of a campaign's machine")
    arguments.add_campaign_folder(parser)
    arguments.add_output_folder(parser, "diagnoses")
    arguments.add_user_effects(parser, "FILE.py:CLASS", "also consider this effect of your own; may be given again")
    arguments.add_cluster(parser, "hand fits to Dask")
    arguments.add_own_code(parser, effects=False)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Find the effects that a campaign's model lacks, write a folder, print the verdict.

    Raises:
        CampaignError: the fit fails.
        KeyboardInterrupt: the user has interrupted it; the text says what is finished.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import ResultFiles, locked_folder
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, Checkpoint, diagnosis_identity
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.tasks.diagnose import DiagnosisResult
    from edhas_jax.tasks.result import SUMMARY_FILE

    campaign = read_campaign(options.campaign, arguments.own_code(options))
    arguments.require_own_code(options, campaign.machine)
    with WorkProgress(options, "checking the data"):
        campaign = checked_campaign(campaign)
    user_effects = [load_effect(spec, trust=[spec]) for spec in options.effects]
    identity = diagnosis_identity(campaign, user_effects)
    out = console(options)
    folder, sentences = _choose_folder(options, campaign.name, identity)
    files = ResultFiles(folder, True, (*DiagnosisResult.files, SUMMARY_FILE))
    with locked_folder(folder):
        for sentence in sentences:
            out.print(sentence, soft_wrap=True)
        print_data_check(out, campaign)
        return _diagnose(options, out, campaign, user_effects, files, Checkpoint(folder / CHECKPOINT_FOLDER, identity))


def _diagnose(options, out, campaign, user_effects, files, checkpoint) -> int:
    """Search, write the result into the folder of `files`, and print it; the exit status."""
    from edhas_jax.config.result_files import ResultFileError, report_write_errors
    from edhas_jax.tasks.diagnose import diagnose

    folder = files.folder
    kept = "finished stages of the search ({}) are kept in {}; the same command goes on from them"
    with WorkProgress(options, "calibrating") as progress:
        try:
            result = diagnose(
                campaign, user_effects, on_progress=progress, checkpoint=checkpoint, cluster=options.cluster
            )
        except KeyboardInterrupt:
            if not checkpoint.kept:
                raise
            raise KeyboardInterrupt(f"edhas: interrupted; {kept.format(checkpoint.kept, folder)}") from None
        try:
            with report_write_errors(folder):
                files.begin()
                experiment, failures, interrupted = result.write_all(folder, checkpoint.failures, progress)
                result.write_summary(folder)
                files.finish()
                if not interrupted:
                    checkpoint.remove()
        except ResultFileError as error:
            if not checkpoint.kept:
                raise
            raise ResultFileError(f"{error}; {kept.format(checkpoint.kept, folder)}") from None
    summary = result.summary_with(experiment, failures)
    follow = _next_command(result, options.campaign, folder) + arguments.own_words(options)
    finish(options, out, summary, folder, follow)


def _next_command(result, campaign: Path, folder: Path) -> str:
    """What to do with a diagnosis: run its model where an effect is missing, otherwise calibrate the present one."""
    from edhas_jax.diagnosis.search.result import Verdict

    if result.verdict is Verdict.ADEQUATE:
        return f"fit {quoted(campaign)}"
    if result.posterior.best.members:
        return f"compare {quoted(campaign)} --model {quoted(folder / 'config.yaml')}"
    return f"plan {quoted(campaign)}"


def _choose_folder(options, name: str, identity: dict[str, str]) -> tuple[Path, list[str]]:
    """The folder to write, that of the same unfinished diagnosis if there is one, and sentences about the choice.

    Raises:
        ResultFileError: the folder of `--out` exists and is not that of an unfinished diagnosis.
    """
    from edhas_jax.config.result_files import holds_nothing, require_new
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, stored_identity

    if options.out:
        folder, places = options.out, [options.out]
    else:
        folder = arguments.output_folder(options, str(DEFAULT_PARENT), name)
        places = sorted(p for p in DEFAULT_PARENT.glob("*") if _without_number(p.name) == _without_number(folder.name))
    sentences, unfinished = [], {p: stored_identity(p / CHECKPOINT_FOLDER) for p in places}
    for place, stored in unfinished.items():
        if stored == identity:
            return place, [f"Going on from the finished fits in {place}."]
        if stored is not None:
            changed = " and ".join(what for what in identity if stored.get(what) != identity[what])
            sentences.append(
                f"The finished fits in {place} are not used, because they were computed from other inputs: "
                f"{changed} changed."
            )
    if unfinished.get(folder) is None and not holds_nothing(folder):
        require_new(folder, options.overwrite)
    return folder, sentences


def _without_number(name: str) -> str:
    """The name of a folder without the number that distinguishes it from earlier ones."""
    return re.sub(r"-\d+$", "", name)
