"""`edhas size`."""

from pathlib import Path

from edhas_jax.commands.console import console, table


def size(options) -> None:
    """`edhas size`: size a machine, write configurations, path and pictures, say what was gained and what limits it."""
    from rich.progress import BarColumn, Progress, TextColumn

    from edhas_jax.config.run_folder import check_free, free_folder
    from edhas_jax.core.units import format_quantity, from_si
    from edhas_jax.design.batch.design_table import own_name
    from edhas_jax.design.sizing.config import load_sizing
    from edhas_jax.design.sizing.figures import draw_front, draw_path
    from edhas_jax.design.sizing.result_folder import save_sizing
    from edhas_jax.design.sizing.sizing import size as size_machine
    from edhas_jax.machine.parameters import get_parameter
    from edhas_jax.simulation.metrics import METRICS

    task = load_sizing(options.config)
    folder = options.out or free_folder(Path("runs"), options.config.stem)
    check_free(folder, options.overwrite)
    out = console()
    with Progress(TextColumn("{task.description}"), BarColumn(), transient=True, console=out) as bar:
        shown = bar.add_task("compiling", total=1.0)
        result = size_machine(task, lambda what, share: bar.update(shown, completed=share, description=what))
    configs = save_sizing(task, result, folder)
    draw_path(task, result).savefig(folder / "path.png", dpi=130)
    if task.front:
        draw_front(task, result).savefig(folder / "front.png", dpi=130)

    out.print(f"[bold]{task.name or options.config.stem}[/bold]: {len(task.free)} dimensions, "
              f"{len(result.start.metrics)} cases; {result.machine_seconds:,.0f} machine-seconds in "
              f"{result.seconds:.0f} s; "
              f"{100 * result.alike:.0f} % of the starts end within 1 % of the best")  # fmt: skip
    heads = ["start", *([f"design {k + 1}" for k in range(len(configs))] if task.front else ["sized"])]
    rows = table("dimensions", "dimension", *heads)
    for axis in task.free:
        unit = own_name(task.machine, axis.name)[0].unit
        values = [float(get_parameter(task.machine, axis.name)), *(s.design[axis.name] for s in result.machines)]
        rows.add_row(axis.name, *(format_quantity(v, unit) for v in values))
    out.print(rows)
    rows = table("metrics, lowest … highest of the cases", "metric", *heads)
    for metric in (c for c in result.start.metrics.columns if c in METRICS):
        unit, usual, _ = METRICS[metric]
        cells = []
        for sized in (result.start, *result.machines):
            low, high = (from_si(float(f(sized.metrics[metric])), unit, usual) for f in (min, max))
            cells.append(f"{low:.4g} … {high:.4g} {usual}" if high > low * 1.0001 else f"{high:.4g} {usual}")
        rows.add_row(metric, *cells)
    out.print(rows)
    for name, sized in zip(heads[1:], result.machines, strict=True):
        held = "; ".join(sized.active) or "nothing: an optimum inside bounds and limits"
        out.print(f"{name}: held back by {held}. {sized.convergence}", soft_wrap=True)
    out.print(f"written to {folder}; run it with: edhas simulate {configs[0]}", soft_wrap=True)
