"""The commands `edhas campaign check` and `edhas campaign new`."""

import time

from edhas_jax.commands.arguments import add_campaign_folder, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, headed, progress_bar, table

STATUS_REMARKS = 1


def add_parser(commands) -> None:
    """Declare the commands and their arguments."""
    actions = commands.add_parser(
        "campaign", help="measurements of a bench: begin a campaign, check its files"
    ).add_subparsers(title="what to do", required=True, metavar="ACTION")
    check = actions.add_parser("check", help="read everything, list what looks wrong; status 1 if anything does")
    add_campaign_folder(check)
    add_own_code(check, effects=False)
    check.set_defaults(command=run_check)
    new = actions.add_parser("new", help="write a commented template that passes the check")
    add_campaign_folder(new, "folder to write")
    new.set_defaults(command=run_new)


def run_check(options) -> int:
    """Read a campaign and list the errors and warnings in its files; the status is 1 when there are any."""
    from edhas_jax.measurements.campaign import Severity
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign
    from edhas_jax.measurements.checks.noise_measurement import noise_sentence

    out = console()
    campaign = read_campaign(options.campaign, own_code(options))
    require_own_code(options, campaign.machine)
    began = time.perf_counter()
    with progress_bar(out, time_remaining=True) as bar:
        task = bar.add_task("checking, and comparing with the model", total=1.0)
        checked = checked_campaign(campaign, lambda share: bar.update(task, completed=share))
    remarks = checked.remarks
    if (sentence := noise_sentence(checked)) is not None:
        out.print(sentence, soft_wrap=True)
    seconds = time.perf_counter() - began
    samples = sum(len(run.time) for run in campaign.runs)
    counted = f"{len(campaign.runs)} runs, {len(campaign.channels)} signals, {samples:,} samples"
    out.print(headed(campaign.name, f": {campaign.machine.name}, {counted}; {seconds:.1f} s"))
    if remarks:
        rows = table(None, "severity", "file", "line", "what")
        for r in remarks:
            rows.add_row(r.severity.value, r.file.name, str(r.line or ""), r.sentence)
        out.print(rows)
    counts = {s: sum(r.severity is s for r in remarks) for s in Severity}
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    if not errors + warnings:
        out.print("no errors, no warnings: all data are used")
        return 0
    out.print(f"errors (data left out): {errors}, warnings (data used unchanged): {warnings}; no file was changed")
    return STATUS_REMARKS


def run_new(options) -> None:
    """Write a commented template of a campaign that passes `edhas campaign check`."""
    from edhas_jax.measurements.campaign_template import write_template

    out = console()
    with progress_bar(out, time_remaining=True) as bar:
        task = bar.add_task("simulating a run for the template", total=1.0)
        paths = write_template(options.campaign, lambda share: bar.update(task, completed=share))
    out.print("written: " + ", ".join(map(str, paths)), soft_wrap=True)
    out.print(f"next: edhas campaign check {options.campaign}", soft_wrap=True)
