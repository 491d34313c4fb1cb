"""The commands that begin something: `edhas new`, `edhas campaign new`, and the examples of the package."""

import os
from pathlib import Path

from edhas_jax.commands.console import finish, quoted, say
from edhas_jax.commands.progress import WorkProgress
from edhas_jax.config.examples import copy_examples, list_examples
from edhas_jax.core.summary import Summary, SummaryTable


def new(options) -> None:
    """Write a commented beginning of a configuration, a rig, a campaign or a task.

    Raises:
        ResultFileError: the file exists or cannot be written.
        CampaignError: the folder of a campaign is not empty or cannot be written.
        RigError: the rig of a campaign cannot be loaded.
    """
    from edhas_jax.config.templates import TASKS, write_beginning, write_rig_template

    kind = options.kind
    if kind == "campaign":
        _begin_campaign(options, options.path or Path("my_campaign"), options.rig)
    elif kind == "rig":
        file, configuration, name = write_rig_template(options.path or Path("my_rig.py"), options.overwrite)
        say(options, f"written: {file}, {configuration}", f"next: edhas check {quoted(file)}:{name}")
    else:
        path = write_beginning(kind, options.path or Path(f"my_{kind}.yaml"), options.overwrite)
        command = kind if kind in TASKS else "simulate"
        say(options, f"written: {path}", f"next: edhas {command} {quoted(path)}")


def new_campaign(options) -> None:
    """Write a commented template of a campaign that passes `edhas campaign check`."""
    _begin_campaign(options, options.campaign)


def _begin_campaign(options, folder: Path, spec: str | None = None) -> None:
    """Write the template of a campaign, of a rig of one's own where `spec` names it."""
    from edhas_jax.machine.own_rig import load_rig
    from edhas_jax.measurements.campaign_template import write_rig_campaign, write_template

    with WorkProgress(options, "simulating a run for the template") as progress:
        if spec is None:
            paths = write_template(folder, progress.share)
        else:
            rig = load_rig(spec, Path(), [spec])
            paths = write_rig_campaign(folder, rig, _spec_within(folder, spec), progress.share)
    more = "" if spec is None else f" --rig {spec}"
    say(options, "written: " + ", ".join(map(str, paths)), f"next: edhas campaign check {quoted(folder)}{more}")


def _spec_within(folder: Path, spec: str) -> str:
    """How a campaign in a folder names a rig that is named from here: a file relative to the folder."""
    source, _, name = spec.rpartition(":")
    if not source.endswith(".py"):
        return spec
    return f"{Path(os.path.relpath(Path(source).resolve(), folder.resolve())).as_posix()}:{name}"


def examples(options) -> None:
    """List the examples, or copy some of them.

    Raises:
        ResultFileError: there is no such example, or the folder cannot be written.
    """
    known = list_examples()
    if not options.names and not options.all:
        rows = [(e.name, e.about, f"edhas {e.command}") for e in known]
        table = SummaryTable.of("examples", ("example", "what it shows", "command"), rows)
        finish(options, Summary(f"examples: {len(rows)}", (table,)), next_command="examples --all")
        return
    copied = copy_examples(options.names, options.out)
    table = SummaryTable.of("copied", ("file",), [(str(path),) for path in copied])
    first = next(e for e in known if e.name == (options.names[0] if options.names else "paper.yaml"))
    task, _, name = first.command.partition(" ")
    said = table if copied else "All of them are there already; nothing was copied."
    summary = Summary(f"examples: {len(copied)} copied to {options.out}", (said,))
    finish(options, summary, next_command=f"{task} {quoted(options.out / name)}")
