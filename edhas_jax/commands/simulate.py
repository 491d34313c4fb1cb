"""The command `edhas simulate`."""

import time
from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish, quoted
from edhas_jax.commands.progress import WorkProgress

STATUS_NOT_VALID = 3


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("simulate", help="run one machine and write a run folder")
    parser.add_argument("config", type=Path, help="configuration, YAML")
    arguments.add_overrides(parser, "piston_clearance=15um")
    arguments.add_own_code(parser)
    arguments.add_output_folder(parser, "runs")
    parser.add_argument("--no-figure", action="store_true", help="write no picture")
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> int:
    """Simulate a machine, write a run folder, print status, metrics and energy ledger.

    Returns:
        The exit status: 0, or 3 if the result is not valid.
    """
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.config.result_files import require_new
    from edhas_jax.tasks.simulate import simulate

    config = read_config(options.config, options.overrides, arguments.own_code(options))
    arguments.require_own_code(options, config.machine)
    folder = arguments.output_folder(options, "runs", options.config.stem)
    require_new(folder, options.overwrite)
    out = console(options)
    began = time.perf_counter()
    with WorkProgress(options, "compiling and simulating") as progress:
        result = simulate(config, on_progress=lambda share: progress("simulating", share))
    seconds = time.perf_counter() - began
    result.save(folder, options.overwrite, figure=not options.no_figure)
    summary = result.summary(config.name or options.config.stem, f"{seconds:.1f} s with compilation")
    finish(options, out, summary, folder, f"parameters {quoted(options.config)}")
    return 0 if result.valid else STATUS_NOT_VALID
