"""The command `edhas sensitivity`."""

import time
from pathlib import Path

from edhas_jax.commands.arguments import add_output_folder, add_own_code, own_code, require_own_code
from edhas_jax.commands.console import console, file_names, headed, progress_bar, save_figure, table

MAX_PRINTED_PARAMETERS = 4  # for each metric

FILES = (
    "points.parquet", "local.parquet", "sobol.parquet", "morris.parquet", "sensitivity.yaml", "machine.yaml",
    "local.png", "sobol.png", "morris.png",
)  # fmt: skip


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("sensitivity", help="which parameters matter where: elasticities, Sobol, Morris")
    parser.add_argument("config", type=Path, help="configuration of the analysis, YAML")
    add_output_folder(parser, "runs")
    add_own_code(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Run a sensitivity analysis, write tables and pictures, print the largest elasticities."""
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors, unused_folder
    from edhas_jax.design.batch.design_table import resolve_parameter
    from edhas_jax.design.sensitivity.analysis import analyse_sensitivity
    from edhas_jax.design.sensitivity.config import load_sensitivity
    from edhas_jax.design.sensitivity.figures import draw_local, draw_morris, draw_sobol
    from edhas_jax.design.sensitivity.result_folder import save_sensitivity

    analysis = load_sensitivity(options.config, own_code(options))
    require_own_code(options, analysis.machine)
    folder = options.out or unused_folder(Path("runs"), options.config.stem)
    files = ResultFiles(folder, options.overwrite, FILES)
    out = console()
    began = time.perf_counter()
    with progress_bar(out) as bar:
        task = bar.add_task("compiling", total=1.0)
        result = analyse_sensitivity(analysis, lambda what, share: bar.update(task, completed=share, description=what))
    with report_write_errors(folder):
        files.begin()
        save_sensitivity(analysis, result, folder)
    units = {n: resolve_parameter(analysis.machine, n)[0].unit for n in result.points.columns}
    pictures = {"local.png": draw_local(result, units)}
    if result.sobol is not None:
        pictures["sobol.png"] = draw_sobol(result, units)
    if result.morris is not None:
        pictures["morris.png"] = draw_morris(result)
    for name, figure in pictures.items():
        save_figure(figure, folder / name)
    with report_write_errors(folder):
        files.finish()

    seconds = time.perf_counter() - began
    out.print(headed(analysis.name or options.config.stem, f": {len(result.points)} operating points, "
              f"{len(analysis.local)} parameters, {len(analysis.metrics)} metrics; {seconds:.1f} s"))  # fmt: skip
    rows = table("largest elasticities", "metric", "parameter", "value", "operating point")
    for metric in analysis.metrics:
        local = result.local[result.local["metric"] == metric].dropna(subset=["elasticity"])
        magnitude = local["elasticity"].abs()
        for k in magnitude.loc[magnitude.groupby(local["parameter"]).idxmax()].nlargest(MAX_PRINTED_PARAMETERS).index:
            point = _operating_point(local.loc[k], units)
            rows.add_row(metric, local["parameter"][k], f"{local['elasticity'][k]:+.2f}", point)
    out.print(rows)
    for note, group in result.local[result.local["note"] != ""].groupby("note"):
        out.print(f"{len(group)} of {len(result.local)}: {note} ({', '.join(group['metric'].unique())})")
    out.print(f"written to {folder}: " + file_names(folder), soft_wrap=True)


def _operating_point(row, units: dict[str, str]) -> str:
    """The values that define an operating point, as text."""
    from edhas_jax.core.units import format_quantity

    return ", ".join(f"{n} {format_quantity(row[n], unit)}" for n, unit in units.items()) or "as configured"
