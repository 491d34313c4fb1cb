"""The command `edhas compare`."""

from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
    add_output_folder,
    add_own_code,
    own_code,
    require_own_code,
)
from edhas_jax.commands.console import console, file_names, print_data_check, styled, table

FILES = "figures.csv", "report.html"  # that the command writes


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("compare", help="the model beside the measurements, and where it fails")
    add_campaign_folder(parser)
    parser.add_argument("--model", type=Path, help="configuration of the model (default: the campaign's own)")
    parser.add_argument(
        "--replay", choices=("set_point", "voltage", "current", "piston_position"), default="set_point",
        help="drive the model with this measured signal, so that what lies behind it is judged alone",
    )  # fmt: skip
    add_output_folder(parser, "comparisons")
    add_own_code(parser)
    parser.set_defaults(command=run)


def run(options) -> None:
    """Simulate the runs of a campaign, write a report, print the residuals and their patterns."""
    from edhas_jax.config.machine_config import read_config
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors, unused_folder
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.comparison import compare
    from edhas_jax.measurements.comparison_report import comparison_report, sentences
    from edhas_jax.measurements.figures_of_merit import figures_of_merit
    from edhas_jax.measurements.replay import Replay
    from edhas_jax.measurements.residual_patterns import find_patterns

    campaign = read_campaign(options.campaign, own_code(options))
    machine = None if options.model is None else read_config(options.model, trust=own_code(options)).machine
    require_own_code(options, campaign.machine, *([] if machine is None else [machine]))
    folder = options.out or unused_folder(Path("comparisons"), campaign.name)
    files = ResultFiles(folder, options.overwrite, FILES)
    out = console()
    with out.status("reading") as status:
        comparison = compare(campaign, machine, replay=Replay(options.replay), on_progress=status.update)
        status.update("looking for patterns")
        patterns = find_patterns(comparison)
        status.update("drawing")
        report = comparison_report(comparison, patterns)
    with report_write_errors(folder):
        files.begin()
        figures_of_merit(comparison).to_csv(folder / "figures.csv")
        (folder / "report.html").write_text(report, encoding="utf-8")
        files.finish()
    print_data_check(out, comparison.campaign, comparison.remarks)
    out.print(residual_table(comparison))
    for number, sentence in enumerate(sentences(patterns), 1):
        out.print(f"{number}. {sentence}", soft_wrap=True)
    if not patterns:
        out.print("The residuals hold nothing but the noise of the sensors.")
    out.print(f"written to {folder}: " + file_names(folder))


def residual_table(comparison):
    """Residual over noise of each run and signal as a rich table: green below 1.15, yellow below 3, else red."""
    rows = table("residual over noise", "run", *comparison.signals)
    for run, row in comparison.rms_over_noise().items():
        cells = [row.get(n) for n in comparison.signals]
        rows.add_row(run, *("" if value is None else styled(f"{value:.2f}", _colour(value)) for value in cells))
    return rows


def _colour(value: float) -> str:
    return "green" if value < 1.15 else "yellow" if value < 3.0 else "red"
