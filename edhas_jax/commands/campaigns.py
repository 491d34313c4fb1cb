"""The commands on a campaign: check it, compare a model with it, fit, diagnose, add effects, plan it."""

import dataclasses
import re
import time
from pathlib import Path

from edhas_jax.commands.command_line import CHECK_FAILED, NOT_CONVERGED
from edhas_jax.commands.console import console, finish, print_data_check, quoted, say
from edhas_jax.commands.options import output_folder, own_code, own_words, require_own_code
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.config.machine_config import read_config
from edhas_jax.config.result_files import (
    ResultFileError,
    ResultFiles,
    holds_nothing,
    locked_folder,
    report_write_errors,
    require_new,
)
from edhas_jax.core.remark import Severity
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.units import to_si
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.measurements.campaign import Campaign, runs_text
from edhas_jax.measurements.campaign_reader import read_campaign
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.checks.noise_measurement import noise_sentence

DIAGNOSES = Path("diagnoses")
NUMBER = r"-\d+$"
TONES = {Severity.ERROR: Tone.BAD, Severity.WARNING: Tone.CAUTION}


def _campaign(options) -> Campaign:
    """The campaign of the command line."""
    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    return campaign


def _checked(options, campaign: Campaign) -> Campaign:
    with WorkProgress(options, "checking the data"):
        return checked_campaign(campaign)


def _next(options, command: str) -> str:
    """A command on the same campaign, with the user's own code."""
    return f"{command} {quoted(options.campaign)}{own_words(options)}"


def check(options) -> int:
    """Read a campaign and list the errors and warnings in its files; the status is 1 when there are any."""
    campaign, began = _campaign(options), time.perf_counter()
    with WorkProgress(options, "checking, and comparing with the model") as progress:
        checked = checked_campaign(campaign, progress.share)
    remarks, noise = checked.remarks, noise_sentence(checked)
    seconds = time.perf_counter() - began
    samples = sum(len(run.time) for run in campaign.runs)
    counted = f"{runs_text(campaign.runs)}, {len(campaign.channels)} signals, {samples:,} samples"
    rows = [
        (Toned(r.severity.value, TONES[r.severity]) if r.severity in TONES else r.severity.value, r.file.name,
         str(r.line or ""), r.sentence)
        for r in remarks
    ]  # fmt: skip
    records = [{"severity": r.severity.value, "file": str(r.file), "line": r.line, "what": r.sentence} for r in remarks]
    errors, warnings = (sum(r.severity is s for r in remarks) for s in TONES)
    verdict = Toned("no errors, no warnings: all data are used", Tone.GOOD)
    if errors + warnings:
        verdict = f"errors (data left out): {errors}, warnings (data used unchanged): {warnings}; no file was changed"
    listed = SummaryTable.of("remarks", ("severity", "file", "line", "what"), rows, records)
    title = f"{campaign.name}: {campaign.machine.name}, {counted}; {seconds:.1f} s"
    summary = Summary(title, (*([] if noise is None else [noise]), *([listed] if rows else []), verdict))
    finish(options, summary, next_command=_next(options, "compare"))
    return CHECK_FAILED if errors + warnings else 0


def compare(options) -> None:
    """Simulate the runs of a campaign, write a report, print the residuals and their patterns."""
    from edhas_jax.measurements.replay import Replay
    from edhas_jax.tasks.compare import ComparisonResult, compare

    trust = own_code(options)
    campaign = read_campaign(options.campaign, trust)
    models = [read_config(options.model, trust=trust).machine] if options.model else []
    require_own_code(options, campaign.machine, *models)
    folder = output_folder(options, "comparisons", campaign.name)
    ComparisonResult.reserve(folder, options.overwrite)
    with WorkProgress(options) as progress:
        result = compare(campaign, options.model, replay=Replay(options.replay), trust=trust, on_progress=progress)
        progress("looking for patterns")
        patterns = result.patterns
        progress("drawing")
        result.save(folder, options.overwrite)
    print_data_check(console(options), result.campaign, result.remarks)
    finish(options, result.summary(), folder, _next(options, "diagnose" if patterns else "fit"))


def fit(options) -> int:
    """Calibrate the uncertain parameters of a campaign's machine, write a folder, print the estimates.

    Returns:
        The exit status: 0, or 4 if the fit has not converged.

    Raises:
        CampaignError: the choices are wrong, a profile is asked of a parameter that is not free, or the fit fails.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.inference.fit.calibration import save_calibration
    from edhas_jax.inference.fit.fit_choices_reader import read_choices
    from edhas_jax.tasks.fit import FitResult, fit, require_uncertain

    campaign = _checked(options, _campaign(options))
    folder = output_folder(options, "fits", campaign.name)
    files = FitResult.reserve(folder, options.overwrite)
    choices = read_choices(options.choices, campaign)
    require_uncertain(options.profile, [u.name for u in choices.unknowns(choices.applied(campaign))])
    print_data_check(console(options), campaign)

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
    say(options, *(f for f in failures if f not in result.failures))
    finish(options, result.summary(), folder, _next(options, "diagnose"))
    return 0 if result.fit.converged else NOT_CONVERGED


def diagnose(options) -> None:
    """Find the effects that a campaign's model lacks, write a folder, print the verdict.

    Raises:
        CampaignError: the fit fails.
        KeyboardInterrupt: the user has interrupted it; the text says what is finished.
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, Checkpoint, diagnosis_identity
    from edhas_jax.tasks.diagnose import DiagnosisResult
    from edhas_jax.tasks.result import SUMMARY_FILE

    campaign = _checked(options, _campaign(options))
    user_effects = [load_effect(spec, trust=[spec]) for spec in options.effects]
    identity = diagnosis_identity(campaign, user_effects)
    folder, sentences = _choose_folder(options, campaign.name, identity)
    files = ResultFiles(folder, True, (*DiagnosisResult.files, SUMMARY_FILE))
    with locked_folder(folder):
        say(options, *sentences)
        print_data_check(console(options), campaign)
        _diagnose(options, campaign, user_effects, files, Checkpoint(folder / CHECKPOINT_FOLDER, identity))


def _diagnose(options, campaign: Campaign, user_effects, files: ResultFiles, checkpoint) -> None:
    """Search, write the result into the folder of `files`, and print it."""
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
    follow = _after_diagnosis(result, options.campaign, folder) + own_words(options)
    finish(options, result.summary_with(experiment, failures), folder, follow)


def _after_diagnosis(result, campaign: Path, folder: Path) -> str:
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
    from edhas_jax.diagnosis.search.checkpoint import CHECKPOINT_FOLDER, stored_identity

    folder = output_folder(options, str(DIAGNOSES), name)
    places = [folder]
    if not options.out:
        # the number at the end of a name distinguishes it from earlier ones
        plain, others = re.sub(NUMBER, "", folder.name), DIAGNOSES.glob("*")
        places = sorted(p for p in others if re.sub(NUMBER, "", p.name) == plain)
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


def add(options) -> None:
    """Fit a campaign's model with more effects, one after the other; write the model, and the campaign with them.

    Raises:
        CampaignError: the fit fails.
        ResultFileError: the folder exists or cannot be written, or one of a diagnosis names no effect.
    """
    from edhas_jax.tasks.add import AddResult, add

    campaign = _campaign(options)
    specs = [spec for given in options.effect for spec in _named(given)]
    effects = [load_effect(spec, trust=[spec]) for spec in specs]
    folder = output_folder(options, "added", f"{campaign.name}_{'+'.join(effect.id for effect in effects)}")
    AddResult.reserve(folder, options.overwrite)
    with WorkProgress(options, "checking the data") as progress:
        result = add(campaign, effects, on_progress=progress)
    result.save(folder, options.overwrite)
    finish(options, result.summary(), folder, f"diagnose {quoted(folder)}{own_words(options)}")


def _named(given: str) -> list[str]:
    """The effects that an argument names: those of a diagnosis, or itself.

    Raises:
        ResultFileError: a diagnosis is damaged or names no effect.
    """
    from edhas_jax.tasks.result import open_result

    if not (Path(given) / "diagnosis.json").is_file():
        return [given]
    if named := open_result(given).numbers.get("effects"):
        return named
    raise ResultFileError(f"{given}: this diagnosis names no effect")


def plan(options) -> None:
    """Predict which effects a planned campaign can detect, write a folder, print the most useful next run.

    Raises:
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign
    from edhas_jax.tasks.plan import PlanResult, plan

    campaign = read_planned_campaign(options.campaign, to_si(options.rate, "Hz", "5 kHz"), own_code(options))
    require_own_code(options, campaign.machine)
    folder = output_folder(options, "plans", campaign.name)
    files = PlanResult.reserve(folder, options.overwrite)
    campaign = _checked(options, campaign)
    print_data_check(console(options), campaign)
    with WorkProgress(options, "compiling") as progress:
        result = plan(campaign, effects=options.effects, on_progress=progress)
        failures = result.write(files)
    say(options, *failures)
    finish(options, result.summary(), folder, f"campaign check {quoted(options.campaign)}")
