"""The commands `edhas campaign check` and `edhas campaign new`."""

import time

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress

STATUS_REMARKS = 1


def add_parser(commands) -> None:
    """Declare the commands and their arguments."""
    actions = commands.add_parser(
        "campaign", help="measurements of a bench: begin a campaign, check its files"
    ).add_subparsers(title="what to do", required=True, metavar="ACTION")
    check = actions.add_parser("check", help="read everything, list what looks wrong; status 1 if anything does")
    arguments.add_campaign_folder(check)
    arguments.add_own_code(check, effects=False)
    arguments.add_output_options(check)
    check.set_defaults(command=run_check)
    new = actions.add_parser("new", help="write a commented template that passes the check")
    arguments.add_campaign_folder(new, "folder to write")
    arguments.add_output_options(new, table=False)
    new.set_defaults(command=run_new)


def run_check(options) -> int:
    """Read a campaign and list the errors and warnings in its files; the status is 1 when there are any."""
    from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
    from edhas_jax.measurements.campaign import Severity, runs_text
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.measurements.checks.noise_measurement import noise_sentence

    out = console(options)
    campaign = read_campaign(options.campaign, arguments.own_code(options))
    arguments.require_own_code(options, campaign.machine)
    began = time.perf_counter()
    with WorkProgress(options, "checking, and comparing with the model") as progress:
        checked = checked_campaign(campaign, progress.share)
    remarks, noise = checked.remarks, noise_sentence(checked)
    seconds = time.perf_counter() - began
    samples = sum(len(run.time) for run in campaign.runs)
    counted = f"{runs_text(campaign.runs)}, {len(campaign.channels)} signals, {samples:,} samples"
    tones = {Severity.ERROR: Tone.BAD, Severity.WARNING: Tone.CAUTION}
    rows = [
        (Toned(r.severity.value, tones[r.severity]) if r.severity in tones else r.severity.value, r.file.name,
         str(r.line or ""), r.sentence)
        for r in remarks
    ]  # fmt: skip
    records = [{"severity": r.severity.value, "file": str(r.file), "line": r.line, "what": r.sentence} for r in remarks]
    counts = {s: sum(r.severity is s for r in remarks) for s in Severity}
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    verdict = Toned("no errors, no warnings: all data are used", Tone.GOOD)
    if errors + warnings:
        verdict = f"errors (data left out): {errors}, warnings (data used unchanged): {warnings}; no file was changed"
    listed = SummaryTable.of("remarks", ("severity", "file", "line", "what"), rows, records)
    title = f"{campaign.name}: {campaign.machine.name}, {counted}; {seconds:.1f} s"
    summary = Summary(title, (*([] if noise is None else [noise]), *([listed] if rows else []), verdict))
    finish(options, out, summary, next_command=f"compare {quoted(options.campaign)}{arguments.own_words(options)}")
    return STATUS_REMARKS if errors + warnings else 0


def run_new(options) -> None:
    """Write a commented template of a campaign that passes `edhas campaign check`."""
    from edhas_jax.measurements.campaign_template import write_template

    out = console(options)
    with WorkProgress(options, "simulating a run for the template") as progress:
        paths = write_template(options.campaign, progress.share)
    out.print("written: " + ", ".join(map(str, paths)), soft_wrap=True)
    out.print(f"next: edhas campaign check {quoted(options.campaign)}", soft_wrap=True)
