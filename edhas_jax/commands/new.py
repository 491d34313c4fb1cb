"""The command `edhas new`."""

import os
from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, quoted
from edhas_jax.commands.progress import WorkProgress

TASKS = ("sweep", "size", "sensitivity")  # of `task_template`
# of `BEGINNINGS`, a rig of one's own, campaigns, and tasks
KINDS = ("pump", "system", "actuator", "rig", "campaign", *TASKS)


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("new", help="write a commented configuration, campaign or task to start from")
    parser.add_argument("kind", choices=KINDS, help="a machine, a rig of your own, a campaign, a task")
    parser.add_argument("path", nargs="?", type=Path, help="file to write, or folder of a campaign (default: my_KIND)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    parser.add_argument("--rig", metavar="FILE.py:CLASS", help="of a campaign: its rig, one of your own, which may run")
    add_output_options(parser, table=False)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Write a commented beginning.

    Raises:
        ResultFileError: the file exists or cannot be written.
        CampaignError: the folder of a campaign is not empty or cannot be written.
        RigError: the rig of a campaign cannot be loaded.
    """
    out = console(options)
    if options.kind == "campaign":
        from edhas_jax.machine.own_rig import load_rig
        from edhas_jax.measurements.campaign_template import write_rig_campaign, write_template

        folder = options.path or Path("my_campaign")
        with WorkProgress(options, "simulating a run for the template") as progress:
            if options.rig is None:
                paths = write_template(folder, progress.share)
            else:
                rig = load_rig(options.rig, Path(), [options.rig])
                paths = write_rig_campaign(folder, rig, _spec_within(folder, options.rig), progress.share)
        more = "" if options.rig is None else f" --rig {options.rig}"
        out.print("written: " + ", ".join(map(str, paths)), soft_wrap=True)
        out.print(f"next: edhas campaign check {quoted(folder)}{more}", soft_wrap=True)
        return
    if options.kind == "rig":
        from edhas_jax.config.templates import write_rig_template

        file, configuration, name = write_rig_template(options.path or Path("my_rig.py"), options.overwrite)
        out.print(f"written: {file}, {configuration}", soft_wrap=True)
        out.print(f"next: edhas check {quoted(file)}:{name}", soft_wrap=True)
        return
    from edhas_jax.config.templates import write_beginning

    path = write_beginning(options.kind, options.path or Path(f"my_{options.kind}.yaml"), options.overwrite)
    out.print(f"written: {path}", soft_wrap=True)
    command = options.kind if options.kind in TASKS else "simulate"
    out.print(f"next: edhas {command} {quoted(path)}", soft_wrap=True)


def _spec_within(folder: Path, spec: str) -> str:
    """How a campaign in a folder names a rig that is named from here: a file relative to the folder."""
    source, _, name = spec.rpartition(":")
    if not source.endswith(".py"):
        return spec
    return f"{Path(os.path.relpath(Path(source).resolve(), folder.resolve())).as_posix()}:{name}"
