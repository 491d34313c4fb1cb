"""`edhas campaign check` and `edhas campaign new`."""

import time

from edhas_jax.commands.console import console, table

FINDINGS = 1


def check_campaign(options) -> int:
    """`edhas campaign check`: read a campaign and list what looks wrong in its files; status 1 when something does."""
    from rich.markup import escape

    from edhas_jax.measurements.campaign import Severity
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.data_checks import check_campaign as check

    out = console()
    campaign = read_campaign(options.campaign)
    began = time.perf_counter()
    with _progress(out) as bar:
        task = bar.add_task("checking, and comparing with the model", total=1.0)
        remarks = check(campaign, lambda share: bar.update(task, completed=share))
    seconds = time.perf_counter() - began
    samples = sum(len(run.time) for run in campaign.runs)
    out.print(
        f"[bold]{campaign.name}[/bold]: {campaign.machine.name}, {len(campaign.runs)} runs, "
        f"{len(campaign.channels)} signals, {samples:,} samples; {seconds:.1f} s"
    )
    if remarks:
        rows = table(None, "severity", "file", "line", "what")
        for r in remarks:
            rows.add_row(r.severity.value, escape(r.file.name), str(r.line or ""), escape(r.sentence))
        out.print(rows)
    counts = {s: sum(r.severity is s for r in remarks) for s in Severity}
    wrong = counts[Severity.ERROR] + counts[Severity.WARNING]
    if not wrong:
        out.print("sound: nothing was left out, nothing looks wrong")
        return 0
    errors, warnings = counts[Severity.ERROR], counts[Severity.WARNING]
    out.print(f"errors (something is left out): {errors}, warnings (used as it is): {warnings}; nothing was repaired")
    return FINDINGS


def new_campaign(options) -> None:
    """`edhas campaign new`: write a commented template that passes the check."""
    from edhas_jax.measurements.campaign_writer import write_template

    out = console()
    with _progress(out) as bar:
        task = bar.add_task("simulating a run for the template", total=1.0)
        paths = write_template(options.campaign, lambda share: bar.update(task, completed=share))
    out.print("written: " + ", ".join(map(str, paths)), soft_wrap=True)
    out.print(f"next: edhas campaign check {options.campaign}", soft_wrap=True)


def _progress(out):
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    return Progress(TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), transient=True, console=out)
