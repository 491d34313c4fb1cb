"""`edhas compare`."""

from pathlib import Path

from edhas_jax.commands.console import console, table


def compare(options) -> None:
    """`edhas compare`: run the model as the bench was run, write a report, print where it fails."""
    from rich.markup import escape

    from edhas_jax.config.machine_config import read_config
    from edhas_jax.config.run_folder import StoreError, check_free, free_folder
    from edhas_jax.measurements.campaign_reader import read_campaign
    from edhas_jax.measurements.comparison import compare as beside
    from edhas_jax.measurements.comparison import figures_of_merit
    from edhas_jax.measurements.comparison_report import comparison_report, sentences
    from edhas_jax.measurements.replay import Replay
    from edhas_jax.measurements.residual_patterns import find_patterns

    campaign = read_campaign(options.campaign)
    machine = None if options.model is None else read_config(options.model).machine
    folder = options.out or free_folder(Path("comparisons"), campaign.name)
    check_free(folder, options.overwrite)
    out = console()
    with out.status("reading") as status:
        found = beside(campaign, machine, replay=Replay(options.replay), on_progress=status.update)
        status.update("looking for patterns")
        patterns = find_patterns(found)
        status.update("drawing")
        report = comparison_report(found, patterns)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        figures_of_merit(found).to_csv(folder / "figures.csv")
        (folder / "report.html").write_text(report, encoding="utf-8")
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from None
    for remark in (*campaign.remarks, *found.remarks):
        out.print(escape(str(remark)), soft_wrap=True)
    out.print(matrix_table(found))
    for number, sentence in enumerate(sentences(patterns), 1):
        out.print(f"{number}. {escape(sentence)}", soft_wrap=True)
    if not patterns:
        out.print("What is left is the sensors' noise.")
    out.print(f"written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())))


def matrix_table(comparison):
    """Residual over noise by run and signal as a rich table, coloured by its size."""
    listed = table("residual over noise", "run", *comparison.signals)
    for run, row in comparison.matrix().items():
        cells = [row.get(n) for n in comparison.signals]
        listed.add_row(run, *("" if value is None else f"[{_colour(value)}]{value:.2f}[/]" for value in cells))
    return listed


def _colour(value: float) -> str:
    return "green" if value < 1.15 else "yellow" if value < 3.0 else "red"
