"""`edhas sensitivity`."""

import time
from pathlib import Path

from edhas_jax.commands.console import console, table


def sensitivity(options) -> None:
    """`edhas sensitivity`: run an analysis, write tables and pictures, say what matters most."""
    from rich.progress import BarColumn, Progress, TextColumn

    from edhas_jax.config.run_folder import check_free, free_folder
    from edhas_jax.design.batch.design_table import own_name
    from edhas_jax.design.sensitivity.analysis import analyse, load_sensitivity, save_findings
    from edhas_jax.design.sensitivity.figures import draw_local, draw_morris, draw_sobol

    task = load_sensitivity(options.config)
    folder = options.out or free_folder(Path("runs"), options.config.stem)
    check_free(folder, options.overwrite)
    out = console()
    began = time.perf_counter()
    with Progress(TextColumn("{task.description}"), BarColumn(), transient=True, console=out) as bar:
        shown = bar.add_task("compiling", total=1.0)
        findings = analyse(task, lambda what, share: bar.update(shown, completed=share, description=what))
    save_findings(task, findings, folder)
    units = {n: own_name(task.machine, n)[0].unit for n in findings.points.columns}
    pictures = {"local.png": draw_local(findings, units)}
    if findings.sobol is not None:
        pictures["sobol.png"] = draw_sobol(findings, units)
    if findings.morris is not None:
        pictures["morris.png"] = draw_morris(findings)
    for name, figure in pictures.items():
        figure.savefig(folder / name, dpi=130)

    seconds = time.perf_counter() - began
    out.print(f"[bold]{task.name or options.config.stem}[/bold]: {len(findings.points)} operating points, "
              f"{len(task.local)} parameters, {len(task.metrics)} metrics; {seconds:.1f} s")  # fmt: skip
    rows = table("largest elasticities", "metric", "parameter", "value", "operating point")
    for metric in task.metrics:
        of = findings.local[findings.local["metric"] == metric].dropna(subset=["elasticity"])
        size = of["elasticity"].abs()
        for k in size.loc[size.groupby(of["parameter"]).idxmax()].nlargest(4).index:
            rows.add_row(metric, of["parameter"][k], f"{of['elasticity'][k]:+.2f}", _told(of.loc[k], units))
    out.print(rows)
    for note, group in findings.local[findings.local["note"] != ""].groupby("note"):
        out.print(f"{len(group)} of {len(findings.local)}: {note} ({', '.join(group['metric'].unique())})")
    out.print(f"written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())), soft_wrap=True)


def _told(row, units: dict[str, str]) -> str:
    from edhas_jax.core.units import format_quantity

    return ", ".join(f"{n} {format_quantity(row[n], unit)}" for n, unit in units.items()) or "as it stands"
