"""The command `edhas size`."""

from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("size", help="find the dimensions that make a machine best within its limits")
    parser.add_argument("config", type=Path, help="configuration of the task, YAML")
    arguments.add_output_folder(parser, "runs")
    arguments.add_own_code(parser)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Size a machine, write configurations, search path and pictures, print dimensions, metrics and active limits."""
    from edhas_jax.design.sizing.config import load_sizing
    from edhas_jax.tasks.size import SizeResult, size

    task = load_sizing(options.config, arguments.own_code(options))
    arguments.require_own_code(options, task.machine)
    folder = arguments.output_folder(options, "runs", options.config.stem)
    SizeResult.reserve(folder, options.overwrite)
    out = console(options)
    with WorkProgress(options, "compiling") as progress:
        result = size(task, on_progress=progress)
    result.save(folder, options.overwrite)
    configs = sorted(folder.glob("sized*.yaml"))
    finish(options, out, result.summary(), folder, f"simulate {quoted(configs[0])}")
