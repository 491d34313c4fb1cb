"""The command `edhas export`."""

import os
from collections import Counter
from pathlib import Path

from edhas_jax.commands.arguments import add_output_file, add_overrides, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, table


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("export", help="the machine as an FMU for Simulink, OpenModelica, Amesim, FMPy")
    parser.add_argument("config", type=Path, help="configuration, YAML")
    add_output_file(parser, "file to write (default: NAME.fmu)")
    parser.add_argument(
        "--input", dest="inputs", action="append", default=[], metavar="NAME",
        help="a parameter that may change during the run, or reference, voltage, target, spool to come from outside; "
             "may be given several times",
    )  # fmt: skip
    add_overrides(parser, "step=10us")
    add_own_code(parser)
    parser.add_argument(
        "--compiler", dest="compilers", action="append", default=[], metavar="COMMAND",
        help="C compiler (default: $CC or cc); several, cross compilers among them, add a binary each",
    )  # fmt: skip
    parser.add_argument("--sources-only", action="store_true", help="compile nothing; the target does it")
    parser.set_defaults(command=run)


def run(options) -> None:
    """Write a configuration as an FMU and print its inputs, size and platforms."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.export.fmu import export_fmu

    compilers = [] if options.sources_only else options.compilers or [os.environ.get("CC") or "cc"]
    config = read_config(options.config, options.overrides, own_code(options))
    require_own_code(options, config.machine)
    path = options.out or Path(f"{options.config.stem}.fmu")
    out = console()
    with out.status("reading") as status:
        unit = export_fmu(
            config, path, options.inputs, compilers, options.overwrite, lambda what: status.update(what),
        )  # fmt: skip
    variables = unit.program.values
    inputs = [v for v in variables if v.causality.value == "input"]
    if inputs:
        rows = table("inputs", "input", "unit", "start", "meaning")
        for v in inputs:
            rows.add_row(v.name, v.unit, f"{v.start:g}", v.doc)
        out.print(rows)
    count = Counter(v.causality.value for v in variables)
    platforms = " and ".join(unit.platforms)
    binary = f"binary for {platforms}" if platforms else "no binary; compile sources/fmu_unit.c on the target"
    effects = ", ".join(e.id for e in config.machine.effects) or "none"
    out.print(
        f"written: {unit.path}, {unit.path.stat().st_size / 1024:.0f} KiB: {config.machine.name}, effects: {effects}; "
        f"{count['input']} inputs, {count['parameter']} parameters, {len(unit.program.outputs)} outputs; "
        f"{binary} and C sources; FMI 2.0 co-simulation",
        soft_wrap=True,
    )  # fmt: skip
