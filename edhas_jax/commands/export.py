"""`edhas export`."""

import os
from collections import Counter
from pathlib import Path

from edhas_jax.commands.console import console, table


def export(options) -> None:
    """`edhas export`: write a configuration as an FMU and print what a user of it connects."""
    from rich.markup import escape

    from edhas_jax.config.machine_config import read_config
    from edhas_jax.export.fmu import export_fmu

    compilers = [] if options.sources_only else options.compilers or [os.environ.get("CC") or "cc"]
    config = read_config(options.config, options.overrides)
    path = options.out or Path(f"{options.config.stem}.fmu")
    out = console()
    with out.status("reading") as status:
        unit = export_fmu(
            config, path, options.inputs, compilers, options.overwrite, lambda what: status.update(escape(what)),
        )  # fmt: skip
    values = unit.program.values
    inputs = [v for v in values if v.causality.value == "input"]
    if inputs:
        rows = table("inputs", "input", "unit", "start", "meaning")
        for v in inputs:
            rows.add_row(v.name, v.unit, f"{v.start:g}", v.doc)
        out.print(rows)
    count = Counter(v.causality.value for v in values)
    platforms = " and ".join(unit.platforms)
    binary = f"binary for {platforms}" if platforms else "no binary; compile sources/fmu_unit.c on the target"
    effects = ", ".join(e.id for e in config.machine.effects) or "none"
    out.print(
        f"written: {unit.path}, {unit.path.stat().st_size / 1024:.0f} KiB: {config.machine.name}, effects: {effects}; "
        f"{count['input']} inputs, {count['parameter']} parameters, {len(unit.program.outputs)} outputs; "
        f"{binary} and C sources; FMI 2.0 co-simulation",
        soft_wrap=True, markup=False,
    )  # fmt: skip
