"""The command `edhas export`."""

import os
from collections import Counter
from pathlib import Path

from edhas_jax.commands import arguments
from edhas_jax.commands.console import console, finish
from edhas_jax.commands.progress import WorkProgress


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("export", help="the machine as an FMU for Simulink, OpenModelica, Amesim, FMPy")
    parser.add_argument("config", type=Path, help="configuration, YAML")
    arguments.add_output_file(parser, "file to write (default: NAME.fmu)")
    parser.add_argument(
        "--input", dest="inputs", action="append", default=[], metavar="NAME",
        help="a parameter that may change during the run, or reference, voltage, target, spool to come from outside; "
             "may be given several times",
    )  # fmt: skip
    arguments.add_overrides(parser, "step=10us")
    arguments.add_own_code(parser)
    parser.add_argument(
        "--compiler", dest="compilers", action="append", default=[], metavar="COMMAND",
        help="C compiler (default: $CC or cc); several, cross compilers among them, add a binary each",
    )  # fmt: skip
    parser.add_argument("--sources-only", action="store_true", help="compile nothing; the target does it")
    arguments.add_output_options(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Write a configuration as an FMU and print its inputs, size and platforms."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.core.summary import Summary, SummaryTable
    from edhas_jax.export.fmu import export_fmu

    compilers = [] if options.sources_only else options.compilers or [os.environ.get("CC") or "cc"]
    config = read_config(options.config, options.overrides, arguments.own_code(options))
    arguments.require_own_code(options, config.machine)
    path = options.out or Path(f"{options.config.stem}.fmu")
    out = console(options)
    with WorkProgress(options) as progress:
        unit = export_fmu(config, path, options.inputs, compilers, options.overwrite, progress)
    variables = unit.program.values
    inputs = [v for v in variables if v.causality.value == "input"]
    rows = [(v.name, v.unit, f"{v.start:g}", v.doc) for v in inputs]
    records = [{"input": v.name, "unit": v.unit, "start": v.start, "meaning": v.doc} for v in inputs]
    table = SummaryTable.of("inputs", ("input", "unit", "start", "meaning"), rows, records, "inputs")
    count = Counter(v.causality.value for v in variables)
    platforms = " and ".join(unit.platforms)
    binary = f"binary for {platforms}" if platforms else "no binary; compile sources/fmu_unit.c on the target"
    effects = ", ".join(e.id for e in config.machine.effects) or "none"
    sentence = (
        f"{count['input']} inputs, {count['parameter']} parameters, {len(unit.program.outputs)} outputs; "
        f"{binary} and C sources; FMI 2.0 co-simulation, {unit.path.stat().st_size / 1024:.0f} KiB"
    )
    title = f"{config.name or options.config.stem}: {config.machine.name}, effects: {effects}"
    summary = Summary(title, (*([table] if rows else []), sentence))
    finish(options, out, summary, written=str(unit.path))
