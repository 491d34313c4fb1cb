"""The commands on code of one's own: check a rig, allow files to run."""

from pathlib import Path

from edhas_jax.commands.command_line import CHECK_FAILED
from edhas_jax.commands.console import console, finish, print_json, print_table, say
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.core import trusted_code
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned


def check(options) -> int:
    """Load a rig, try it, print what was found.

    Returns:
        The exit status: 0, or 1 if a check has failed.

    Raises:
        RigError: the rig cannot be loaded, or its declarations or equations are wrong.
    """
    from edhas_jax.machine.own_rig import load_rig
    from edhas_jax.machine.rigs import RIGS
    from edhas_jax.simulation.rig_contract import Finding, check_contract

    rig = RIGS.get(options.rig) or load_rig(options.rig, Path(), [options.rig])
    machine = rig()
    count = len(machine.initial_state())
    numbers = f"{count} states, {len(rig.drives)} drives, {len(machine.signals) - 1} signals, {len(rig.slots)} slots"
    findings = [Finding("declarations", True, f"units, names and a dry trace: {numbers}")]
    with WorkProgress(options) as progress:
        findings += check_contract(machine, progress)
    marks = {True: Toned("passed", Tone.GOOD), False: Toned("FAILED", Tone.BAD)}
    rows = [(found.check, marks[bool(found.passed)], found.sentence) for found in findings]
    records = [{"check": found.check, "passed": found.passed, "sentence": found.sentence} for found in findings]
    failed = sum(not found.passed for found in findings)
    words = f"{failed} of {len(findings)} checks failed" if failed else f"all {len(findings)} checks passed"
    table = SummaryTable.of("checks", ("check", "result", "figures"), rows, records)
    finish(options, Summary(f"{rig.name}: {words}", (table,)))
    return CHECK_FAILED if failed else 0


def trust(options) -> None:
    """Allow files, withdraw the permission, or list the files that are allowed.

    Raises:
        TrustError: a file cannot be read, is not on the list, or the list cannot be written.
    """
    for file in options.files:
        changed = (trusted_code.distrust if options.remove else trusted_code.trust)(file)
        what = "runs no more" if options.remove else "may run from now on, until its content changes"
        say(options, f"{file}: {what} (list: {changed})")
    if options.files and not options.json:
        return
    known = trusted_code.remembered_files()
    if options.json:
        print_json({"files": [{"file": str(path), "sha256": digest} for digest, path in known.items()]})
    elif known:
        rows = [(str(path), digest[:12]) for digest, path in known.items()]
        print_table(console(options), SummaryTable.of("files", ("file", "hash of its content"), rows))
    else:
        console(options).print("no file is allowed to run; allow one with: edhas trust FILE.py")
