"""The command `edhas sensitivity`."""

from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("sensitivity", help="which parameters matter where: elasticities, Sobol, Morris")
    parser.add_argument("config", type=Path, help="configuration of the analysis, YAML")
    arguments.add_output_folder(parser, "runs")
    arguments.add_own_code(parser)
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Run a sensitivity analysis, write tables and pictures, print the largest elasticities."""
    from edhas_jax.design.sensitivity.config import load_sensitivity
    from edhas_jax.tasks.sensitivity import SensitivityResult, sensitivity

    task = load_sensitivity(options.config, arguments.own_code(options))
    arguments.require_own_code(options, task.machine)
    folder = arguments.output_folder(options, "runs", options.config.stem)
    SensitivityResult.reserve(folder, options.overwrite)
    out = console(options)
    with WorkProgress(options, "compiling") as progress:
        result = sensitivity(task, on_progress=progress)
    result.save(folder, options.overwrite)
    finish(options, out, result.summary(), folder, f"simulate {quoted(folder / 'machine.yaml')}")
