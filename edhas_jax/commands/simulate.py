"""The command `edhas simulate`."""

import time
from pathlib import Path

from edhas_jax.commands.arguments import add_output_folder, add_overrides, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, file_names, headed, progress_bar, table

STATUS_NOT_VALID = 3
SMALLEST_SHARE = 5e-4  # of the energy; smaller entries of the ledger are not printed


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("simulate", help="run one machine and write a run folder")
    parser.add_argument("config", type=Path, help="configuration, YAML")
    add_overrides(parser, "piston_clearance=15um")
    add_own_code(parser)
    add_output_folder(parser, "runs")
    parser.add_argument("--no-figure", action="store_true", help="write no picture")
    parser.set_defaults(command=run)


def run(options) -> int:
    """Simulate a machine, write a run folder, print status, metrics and energy ledger.

    Returns:
        The exit status: 0, or 3 if the result is not valid.
    """
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.config.run_folder import require_new_folder, save_run, unused_folder
    from edhas_jax.simulation.run import simulate

    config = read_config(options.config, options.overrides, own_code(options))
    require_own_code(options, config.machine)
    folder = options.out or unused_folder(Path("runs"), options.config.stem)
    require_new_folder(folder, options.overwrite)
    out = console()
    began = time.perf_counter()
    with progress_bar(out, time_remaining=True) as bar:
        task = bar.add_task("compiling and simulating", total=1.0)
        result = simulate(
            config.machine, config.simulation,
            lambda share: bar.update(task, completed=share, description="simulating"),
        )  # fmt: skip
    seconds = time.perf_counter() - began
    folder = save_run(result, folder, overwrite=options.overwrite, figure=not options.no_figure)

    effects = ", ".join(e.id for e in result.machine.effects) or "none"
    out.print(headed(config.name or options.config.stem, f": {result.machine.name}, effects: {effects}"))
    out.print(f"{result.step_note}; {config.simulation.precision.value}; {seconds:.1f} s with compilation")
    out.print(status_line(result), soft_wrap=True)
    out.print(metrics_table(result))
    out.print(ledger_table(result))
    out.print(f"written to {folder}: " + file_names(folder), soft_wrap=True)
    return 0 if result.valid else STATUS_NOT_VALID


def status_line(run):
    """The status of a run with its reason: green if all is well, yellow for a warning, red if it is not valid."""
    from edhas_jax.simulation.validity import Status

    name = run.status.name.lower()
    if run.status is Status.OK:
        head, colour = "valid", "green"
    else:
        head = f"valid, with a warning: {name}" if run.valid else f"not valid: {name}"
        colour = "yellow" if run.valid else "red"
    return headed(head, f": {run.reason}", colour)


def metrics_table(run):
    """The metrics of a run as a rich table in engineering units, or a sentence that says why there are none."""
    from edhas_jax.core.units import from_si
    from edhas_jax.simulation.metrics import RunTooShortError

    try:
        metrics = run.metrics
    except RunTooShortError as error:
        return f"no metrics: {error}"
    rows = table(None, "metric", "value", "unit", "meaning")
    for name, metric in metrics.items():
        unit = "" if metric.display_unit == "-" else metric.display_unit
        rows.add_row(name, f"{from_si(metric.value, metric.unit, metric.display_unit):.5g}", unit, metric.doc)
    return rows


def ledger_table(run):
    """The energy ledger of a run as a rich table, without entries below `SMALLEST_SHARE`."""
    from edhas_jax.core.units import format_quantity

    rows = table("energy ledger", "row", "group", "energy", "share")
    for entry in run.ledger().itertuples():
        if abs(entry.share) >= SMALLEST_SHARE:
            rows.add_row(entry.Index, entry.group, format_quantity(entry.energy, "J"), f"{100 * entry.share:.1f} %")
    residual = run.energy_residual()
    rows.caption = f"energy balance error: {abs(residual):.0e} of the energy turned over"
    return rows
