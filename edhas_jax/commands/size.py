"""The command `edhas size`."""

from pathlib import Path

from edhas_jax.commands.arguments import add_output_folder, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, headed, progress_bar, save_figure, table

FILES = (
    "sized*.yaml", "start.yaml", "sizing.yaml", "path.parquet", "result.json", "path.png", "front.png"
)  # fmt: skip


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("size", help="find the dimensions that make a machine best within its limits")
    parser.add_argument("config", type=Path, help="configuration of the task, YAML")
    add_output_folder(parser, "runs")
    add_own_code(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Size a machine, write configurations, search path and pictures, print dimensions, metrics and active limits."""
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors, unused_folder
    from edhas_jax.core.units import format_quantity, from_si
    from edhas_jax.design.batch.design_table import resolve_parameter
    from edhas_jax.design.sizing.config import load_sizing
    from edhas_jax.design.sizing.figures import draw_front, draw_path
    from edhas_jax.design.sizing.result_folder import save_sizing
    from edhas_jax.design.sizing.size import size
    from edhas_jax.machine.parameters import get_parameter
    from edhas_jax.simulation.metrics import METRICS

    sizing = load_sizing(options.config, own_code(options))
    require_own_code(options, sizing.machine)
    folder = options.out or unused_folder(Path("runs"), options.config.stem)
    files = ResultFiles(folder, options.overwrite, FILES)
    out = console()
    with progress_bar(out) as bar:
        task = bar.add_task("compiling", total=1.0)
        result = size(sizing, lambda what, share: bar.update(task, completed=share, description=what))
    with report_write_errors(folder):
        files.begin()
        configs = save_sizing(sizing, result, folder)
        save_figure(draw_path(sizing, result), folder / "path.png")
        if sizing.front:
            save_figure(draw_front(sizing, result), folder / "front.png")
        files.finish()

    out.print(headed(sizing.name or options.config.stem, f": {len(sizing.variables)} dimensions, "
              f"{len(result.start.metrics)} cases; {result.machine_seconds:,.0f} machine-seconds in "
              f"{result.seconds:.0f} s; "
              f"{100 * result.share_near_best:.0f} % of the starts end within 1 % of the best"))  # fmt: skip
    heads = ["start", *([f"design {k + 1}" for k in range(len(configs))] if sizing.front else ["sized"])]
    rows = table("dimensions", "dimension", *heads)
    for axis in sizing.variables:
        unit = resolve_parameter(sizing.machine, axis.name)[0].unit
        values = [float(get_parameter(sizing.machine, axis.name)), *(s.design[axis.name] for s in result.machines)]
        rows.add_row(axis.name, *(format_quantity(v, unit) for v in values))
    out.print(rows)
    rows = table("metrics, lowest … highest of the cases", "metric", *heads)
    for metric in (c for c in result.start.metrics.columns if c in METRICS):
        si_unit, display_unit, _ = METRICS[metric]
        cells = []
        for sized in (result.start, *result.machines):
            low, high = (from_si(float(f(sized.metrics[metric])), si_unit, display_unit) for f in (min, max))
            span = f"{low:.4g} … {high:.4g}" if high > low * 1.0001 else f"{high:.4g}"
            cells.append(f"{span} {display_unit}")
        rows.add_row(metric, *cells)
    out.print(rows)
    for name, sized in zip(heads[1:], result.machines, strict=True):
        limits = "; ".join(sized.active) or "no bound or limit (interior optimum)"
        out.print(f"{name}: limited by {limits}. {sized.convergence}", soft_wrap=True)
    out.print(f"written to {folder}; run it with: edhas simulate {configs[0]}", soft_wrap=True)
