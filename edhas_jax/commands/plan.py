"""The command `edhas plan`."""

from pathlib import Path

from edhas_jax.commands.arguments import (
    add_campaign_folder,
    add_output_folder,
    add_own_code,
    add_user_effects,
    own_code,
    require_own_code,
)
from edhas_jax.commands.console import console, file_names, print_data_check, progress_bar, save_figure, table
from edhas_jax.commands.interruption import STATUS_INTERRUPTED, terminate_as_interrupt

MAX_PRINTED_PAIRS = 12

FILES = "plan.json", "sizes.png", "overlaps.png"  # that the command writes


def add_parser(commands) -> None:
    """Declare the command and its arguments."""
    parser = commands.add_parser("plan", help="before any test: what a campaign's runs and sensors could reveal")
    add_campaign_folder(parser, "folder of the campaign; its runs need no files yet")
    parser.add_argument("--rate", default="5 kHz", help="sampling of runs without a file (default: 5 kHz)")
    add_user_effects(parser, "FILE.py:Class", "also consider this effect of your own; may be given several times")
    add_output_folder(parser, "plans")
    add_own_code(parser, effects=False)
    parser.set_defaults(command=run)


def run(options) -> int | None:
    """Predict which effects a planned campaign can detect, write a folder, print the most useful next run.

    Returns:
        The exit status of a command that was interrupted after the sizes were known, else None.

    Raises:
        ResultFileError: the folder exists or cannot be written.
    """
    from edhas_jax.config.result_files import ResultFiles
    from edhas_jax.config.run_folder import report_write_errors, unused_folder, write_json
    from edhas_jax.core.optional_parts import OptionalParts
    from edhas_jax.core.units import to_si
    from edhas_jax.diagnosis.planning.detectability_plan import plan_as_json, plan_detectability
    from edhas_jax.diagnosis.planning.figures import draw_similarity, draw_thresholds
    from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign
    from edhas_jax.machine.effects.loading import load_effect
    from edhas_jax.measurements.checks.campaign_checks import checked_campaign

    campaign = read_planned_campaign(options.campaign, to_si(options.rate, "Hz", "5 kHz"), own_code(options))
    require_own_code(options, campaign.machine)
    folder = options.out or unused_folder(Path("plans"), campaign.name)
    files = ResultFiles(folder, options.overwrite, FILES)
    user_effects = [load_effect(spec, trust=[spec]) for spec in options.effects]
    out, optional = console(), OptionalParts()
    with out.status("checking the data"):
        campaign = checked_campaign(campaign)
    print_data_check(out, campaign)
    with terminate_as_interrupt(), progress_bar(out) as bar:
        task = bar.add_task("compiling", total=1.0)
        planned = plan_detectability(
            campaign, more=user_effects,
            on_progress=lambda what, share: bar.update(task, completed=share, description=what),
        )  # fmt: skip
    with report_write_errors(folder):
        files.begin()
        write_json(folder / "plan.json", plan_as_json(planned))
        for name, draw in (("sizes.png", draw_thresholds), ("overlaps.png", draw_similarity)):
            optional.attempt(name, lambda name=name, draw=draw: save_figure(draw(planned), folder / name))
        files.finish()
    out.print(sizes_table(planned))
    pairs = planned.indistinguishable_pairs()
    if pairs:
        rows = table("detectable, but not distinguishable", "one", "other", "cosine")
        for one, other, cosine in pairs[:MAX_PRINTED_PAIRS]:
            rows.add_row(one, other, f"{cosine:.4f}")
        out.print(rows)
        if len(pairs) > MAX_PRINTED_PAIRS:
            out.print(f"and {len(pairs) - MAX_PRINTED_PAIRS} more pairs, in {folder / 'plan.json'}", soft_wrap=True)
    out.print(planned.sentence(), soft_wrap=True)
    for sentence in optional.failures:
        out.print(sentence, soft_wrap=True)
    out.print(f"written to {folder}: " + file_names(folder), soft_wrap=True)
    return STATUS_INTERRUPTED if planned.interrupted else None


def sizes_table(planned):
    """The smallest size of each candidate that the campaign would detect, as a rich table."""
    rows = table("smallest detectable size", "candidate", "where", "parameter", "detectable from", "plausible",
                   "share of the strongest")  # fmt: skip
    for s in planned.candidates:
        share = f"{s.threshold_share:.2g}" if s.detectable else "not detectable"
        rows.add_row(s.candidate.name, s.candidate.location, s.parameter, s.threshold_text(), s.plausible_text(), share)
    return rows
