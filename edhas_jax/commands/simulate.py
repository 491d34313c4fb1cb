"""`edhas simulate`."""

import time
from pathlib import Path

from edhas_jax.commands.console import console, table


def simulate(options) -> None:
    """`edhas simulate`: run a machine, write a run folder, print metrics and ledger."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from edhas_jax.config.machine_config import read_config
    from edhas_jax.config.run_folder import check_free, free_folder, save_run
    from edhas_jax.simulation.run import simulate as run_machine

    config = read_config(options.config, options.overrides)
    folder = options.out or free_folder(Path("runs"), options.config.stem)
    check_free(folder, options.overwrite)
    out = console()
    began = time.perf_counter()
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), transient=True, console=out
    ) as bar:
        task = bar.add_task("compiling and simulating", total=1.0)
        run = run_machine(
            config.machine, config.simulation,
            lambda share: bar.update(task, completed=share, description="simulating"),
        )  # fmt: skip
    seconds = time.perf_counter() - began
    folder = save_run(run, folder, overwrite=options.overwrite, figure=not options.no_figure)

    effects = ", ".join(e.id for e in run.machine.effects) or "none"
    out.print(f"[bold]{config.name or options.config.stem}[/bold]: {run.machine.name}, effects: {effects}")
    out.print(f"{run.step_note}; {config.simulation.precision.value}; {seconds:.1f} s with compilation")
    out.print(metrics_table(run))
    out.print(ledger_table(run))
    out.print(f"written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())), soft_wrap=True)


def metrics_table(run):
    """The metrics of a run as a rich table, in engineering units, or the sentence that says why there are none."""
    from edhas_jax.core.units import from_si
    from edhas_jax.simulation.metrics import TooShort

    try:
        metrics = run.metrics
    except TooShort as error:
        return f"no metrics: {error}"
    listed = table(None, "metric", "value", "unit", "meaning")
    for name, metric in metrics.items():
        unit = "" if metric.shown == "-" else metric.shown
        listed.add_row(name, f"{from_si(metric.value, metric.unit, metric.shown):.5g}", unit, metric.doc)
    return listed


def ledger_table(run):
    """Where the energy of a run went, as a rich table; small entries are left out."""
    from edhas_jax.core.units import format_quantity

    listed = table("where the energy went", "row", "group", "energy", "share")
    for row in run.ledger().itertuples():
        if abs(row.share) >= 5e-4:
            listed.add_row(row.Index, row.group, format_quantity(row.energy, "J"), f"{100 * row.share:.1f} %")
    residual = run.energy_residual()
    listed.caption = f"not accounted for: {abs(residual):.0e} of the energy turned over"
    return listed
