"""The command `edhas new`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_options
from edhas_jax.commands.console import console, quoted
from edhas_jax.commands.progress import WorkProgress

KINDS = ("pump", "system", "actuator", "rig", "campaign")  # of `BEGINNINGS`, a rig of one's own, and campaigns


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("new", help="write a commented configuration or campaign to start from")
    parser.add_argument("kind", choices=KINDS, help="pump bench, system, actuator, a rig of your own, a campaign")
    parser.add_argument("path", nargs="?", type=Path, help="file to write, or folder of a campaign (default: my_KIND)")
    parser.add_argument("--overwrite", action="store_true", help="replace the file if it exists")
    add_output_options(parser, table=False)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Write a commented beginning.

    Raises:
        ResultFileError: the file exists or cannot be written.
        CampaignError: the folder of a campaign is not empty or cannot be written.
    """
    out = console(options)
    if options.kind == "campaign":
        from edhas_jax.measurements.campaign_template import write_template

        folder = options.path or Path("my_campaign")
        with WorkProgress(options, "simulating a run for the template") as progress:
            paths = write_template(folder, progress.share)
        out.print("written: " + ", ".join(map(str, paths)), soft_wrap=True)
        out.print(f"next: edhas campaign check {quoted(folder)}", soft_wrap=True)
        return
    if options.kind == "rig":
        from edhas_jax.config.rig_template import write_rig_template

        file, configuration, name = write_rig_template(options.path or Path("my_rig.py"), options.overwrite)
        out.print(f"written: {file}, {configuration}", soft_wrap=True)
        out.print(f"next: edhas check {quoted(file)}:{name}", soft_wrap=True)
        return
    from edhas_jax.config.machine_template import write_machine_template

    path = write_machine_template(options.kind, options.path or Path(f"my_{options.kind}.yaml"), options.overwrite)
    out.print(f"written: {path}", soft_wrap=True)
    out.print(f"next: edhas simulate {quoted(path)}", soft_wrap=True)
