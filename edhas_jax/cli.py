"""The command line: `edhas simulate | parameters | effects | schema`."""

import argparse
import json
import sys
import time
from pathlib import Path

import edhas_jax

USER_ERROR = 2
CHOSEN = "chosen; the paper is silent"


def main(arguments: list[str] | None = None) -> int:
    """Run one command; the exit status is 0, or 2 with one clear message when the input is at fault."""
    options = _parser().parse_args(arguments)
    # one line for bad input, wherever it was found; anything else is a defect and keeps its traceback
    from edhas_jax.config import ConfigError
    from edhas_jax.effects import EffectError
    from edhas_jax.parameters import ParameterError
    from edhas_jax.run import SimulationError
    from edhas_jax.store import StoreError
    from edhas_jax.units import UnitError

    try:
        options.command(options)
    except (ConfigError, EffectError, ParameterError, SimulationError, StoreError, UnitError) as error:
        print(f"edhas: {error}", file=sys.stderr)
        return USER_ERROR
    except BrokenPipeError:
        sys.stderr.close()
    except KeyboardInterrupt:
        print("edhas: interrupted before anything was finished; nothing was written", file=sys.stderr)
        return 130
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="edhas", description=edhas_jax.__doc__)
    parser.add_argument("--version", action="version", version=f"edhas_jax {edhas_jax.__version__}")
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    simulate = commands.add_parser("simulate", help="run one machine and write a run folder")
    simulate.add_argument("config", type=Path, help="configuration, YAML")
    simulate.add_argument(
        "--set", dest="overrides", action="append", default=[], metavar="NAME=VALUE",
        help="override a parameter or simulation setting, with unit: --set piston_clearance=15um",
    )  # fmt: skip
    simulate.add_argument("--out", type=Path, help="folder to write (default: runs/NAME, numbered if it exists)")
    simulate.add_argument("--overwrite", action="store_true", help="replace the run folder given with --out")
    simulate.add_argument("--no-figure", action="store_true", help="write no picture")
    simulate.set_defaults(command=_simulate)

    parameters = commands.add_parser("parameters", help="every parameter with unit, value, range, meaning, source")
    parameters.add_argument("config", nargs="?", type=Path, help="configuration (default: all rigs and effects)")
    parameters.set_defaults(command=_parameters)

    effects = commands.add_parser("effects", help="the library of effects; with a name, one effect in full")
    effects.add_argument("name", nargs="?", help="id of an effect, or FILE.py:Class")
    effects.add_argument("--config", type=Path, help="list the effects of this configuration, a user's own included")
    effects.set_defaults(command=_effects)

    schema = commands.add_parser("schema", help="the JSON schema of configurations, for completion in editors")
    schema.set_defaults(command=lambda options: print(_schema()))
    return parser


def _schema() -> str:
    from edhas_jax.schema import json_schema

    return json.dumps(json_schema(), indent=2, ensure_ascii=False)


def _console():
    from rich.console import Console

    # a pipe has no width: let tables be as wide as they are
    return Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=200)


def _table(title: str | None, *columns: str):
    from rich import box
    from rich.table import Table

    table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", pad_edge=False, title_style="bold")
    for column in columns:
        numeric = column in ("value", "default", "share", "energy")
        table.add_column(column, justify="right" if numeric else "left", no_wrap=numeric)
    return table


def _simulate(options) -> None:
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    from edhas_jax.config import read_config
    from edhas_jax.run import simulate
    from edhas_jax.store import StoreError, free_folder, save_run

    config = read_config(options.config, options.overrides)
    folder = options.out or free_folder(Path("runs"), options.config.stem)
    if folder.exists() and not options.overwrite:
        raise StoreError(f"{folder}: exists already; nothing was written. Name another folder or add --overwrite")
    console = _console()
    began = time.perf_counter()
    with Progress(
        TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn(), transient=True, console=console
    ) as bar:
        task = bar.add_task("compiling and simulating", total=1.0)
        run = simulate(
            config.machine, config.simulation,
            lambda share: bar.update(task, completed=share, description="simulating"),
        )  # fmt: skip
    seconds = time.perf_counter() - began
    folder = save_run(run, folder, overwrite=options.overwrite, figure=not options.no_figure)

    effects = ", ".join(e.id for e in run.machine.effects) or "none"
    console.print(f"[bold]{config.name or options.config.stem}[/bold]: {run.machine.name}, effects: {effects}")
    console.print(f"{run.step_note}; {config.simulation.precision.value}; {seconds:.1f} s with compilation")
    console.print(metrics_table(run))
    console.print(ledger_table(run))
    console.print(f"written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())), soft_wrap=True)


def metrics_table(run):
    """The metrics of a run as a rich table, in engineering units, or the sentence that says why there are none."""
    from edhas_jax.metrics import TooShort
    from edhas_jax.units import from_si

    try:
        metrics = run.metrics
    except TooShort as error:
        return f"no metrics: {error}"
    table = _table(None, "metric", "value", "unit", "meaning")
    for name, metric in metrics.items():
        unit = "" if metric.shown == "-" else metric.shown
        table.add_row(name, f"{from_si(metric.value, metric.unit, metric.shown):.5g}", unit, metric.doc)
    return table


def ledger_table(run):
    """Where the energy of a run went, as a rich table; small entries are left out."""
    from edhas_jax.units import format_quantity

    table = _table("where the energy went", "row", "group", "energy", "share")
    for row in run.ledger().itertuples():
        if abs(row.share) >= 5e-4:
            table.add_row(row.Index, row.group, format_quantity(row.energy, "J"), f"{100 * row.share:.1f} %")
    residual = run.energy_residual()
    table.caption = f"not accounted for: {abs(residual):.0e} of the energy turned over"
    return table


def _parameters(options) -> None:
    from edhas_jax import tree
    from edhas_jax.config import read_config
    from edhas_jax.parameters import list_parameters
    from edhas_jax.units import format_quantity

    console = _console()
    if options.config:
        listed = [(p, value) for p, value, _ in list_parameters(read_config(options.config).machine)]
        title = f"parameters of {options.config}"
    else:
        listed, title = [(p, p.default) for owner in _owners() for p in tree.parameters(owner)], "parameters"
    table = _table(title, "parameter", "of", "value" if options.config else "default", "allowed", "meaning", "source")
    for p, value in listed:
        low, high = (format_quantity(bound, p.unit) for bound in p.span)
        value = format_quantity(float(value), p.unit)
        table.add_row(p.name, tree.owner_id(p.owner), value, f"{low} … {high}", p.doc, p.source or CHOSEN)
    console.print(table)


def _owners() -> list[type]:
    """Every struct that declares parameters: the parts of all rigs, the alternatives, the library."""
    import typing

    from edhas_jax import system
    from edhas_jax.effects import LIBRARY

    found: dict[type, None] = {}
    for rig in system.RIGS.values():
        for name, kind in typing.get_type_hints(rig).items():
            if name == "effects":
                continue
            for owner in typing.get_args(kind) or (kind,):
                if hasattr(owner, "__dataclass_fields__"):
                    found[owner] = None
    return [*found, *LIBRARY]


def _effects(options) -> None:
    from edhas_jax import tree
    from edhas_jax.config import read_config
    from edhas_jax.effects import LIBRARY
    from edhas_jax.effects.discover import load_effect
    from edhas_jax.units import format_quantity

    console = _console()
    if options.name:
        effect = load_effect(options.name)
        console.print(f"[bold]{effect.id}[/bold]  {effect.__doc__ or ''}", markup=True)
        console.print("enters at: " + ", ".join(f"{s.name} ({s.where})" for s in effect.slots))
        table = _table(None, "parameter", "default", "allowed", "meaning")
        for p in tree.parameters(effect):
            low, high = (format_quantity(bound, p.unit) for bound in p.span)
            table.add_row(p.name, format_quantity(p.default, p.unit), f"{low} … {high}", p.doc)
        console.print(table)
        for name, state in effect.states.items():
            console.print(f"state: {name}, {state.doc}, in {state.unit}")
        return
    effects = LIBRARY
    if options.config:
        effects = tuple(type(e) for e in read_config(options.config).machine.effects)
    table = _table("effects", "effect", "acts on", "what it is", "parameters")
    for effect in effects:
        where = ", ".join(dict.fromkeys(s.where for s in effect.slots))
        what = (effect.__doc__ or "").strip().split("\n")[0]
        table.add_row(effect.id, where, what, ", ".join(p.name for p in tree.parameters(effect)))
    console.print(table)


if __name__ == "__main__":
    sys.exit(main())
