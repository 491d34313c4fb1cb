"""The command `edhas check`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, finish
from edhas_jax.commands.progress import WorkProgress

STATUS_FAILED = 1


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("check", help="try a machine of your own against what every rig must satisfy")
    parser.add_argument("rig", metavar="FILE.py:CLASS", help="the rig, which may then run; or a rig of the package")
    add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> int:
    """Load a rig, try it, print what was found.

    Returns:
        The exit status: 0, or 1 if a check has failed.

    Raises:
        RigError: the rig cannot be loaded, or its declarations or equations are wrong.
    """
    from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
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
    rows, records = [], []
    for found in findings:
        mark = Toned("passed", Tone.GOOD) if found.passed else Toned("FAILED", Tone.BAD)
        rows.append((found.check, mark, found.sentence))
        records.append({"check": found.check, "passed": found.passed, "sentence": found.sentence})
    failed = sum(not found.passed for found in findings)
    words = f"{failed} of {len(findings)} checks failed" if failed else f"all {len(findings)} checks passed"
    table = SummaryTable.of("checks", ("check", "result", "figures"), rows, records)
    finish(options, console(options), Summary(f"{rig.name}: {words}", (table,)))
    return STATUS_FAILED if failed else 0
