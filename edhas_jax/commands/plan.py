"""`edhas plan`."""

import json
from pathlib import Path

from edhas_jax.commands.console import console, table

MOST_PAIRS = 12


def plan(options) -> None:
    """`edhas plan`: say what a campaign could reveal before it is made, write a folder, print the next run."""
    from rich.progress import BarColumn, Progress, TextColumn

    from edhas_jax.config.run_folder import StoreError, check_free, free_folder
    from edhas_jax.core.units import to_si
    from edhas_jax.diagnosis.planning.candidate_runs import read_planned
    from edhas_jax.diagnosis.planning.detectability_plan import as_json
    from edhas_jax.diagnosis.planning.detectability_plan import plan as foresee
    from edhas_jax.diagnosis.planning.figures import draw_overlaps, draw_sizes
    from edhas_jax.machine.effects.loading import load_effect

    campaign = read_planned(options.campaign, to_si(options.rate, "Hz", "5 kHz"))
    folder = options.out or free_folder(Path("plans"), campaign.name)
    check_free(folder, options.overwrite)
    more = [load_effect(spec) for spec in options.effects]
    out = console()
    with Progress(TextColumn("{task.description}"), BarColumn(), transient=True, console=out) as bar:
        shown = bar.add_task("compiling", total=1.0)
        found = foresee(
            campaign, more=more,
            on_progress=lambda what, share: bar.update(shown, completed=share, description=what),
        )  # fmt: skip
    try:
        folder.mkdir(parents=True, exist_ok=True)
        plain = json.dumps(as_json(found), indent=2, allow_nan=False)
        (folder / "plan.json").write_text(plain + "\n", encoding="utf-8")
        draw_sizes(found).savefig(folder / "sizes.png", dpi=130)
        draw_overlaps(found).savefig(folder / "overlaps.png", dpi=130)
    except OSError as error:
        raise StoreError(f"{folder}: cannot be written: {error.strerror}") from None
    out.print(sizes_table(found))
    pairs = found.pairs()
    if pairs:
        listed = table("seen, but not told apart", "one", "other", "cosine")
        for one, other, cosine in pairs[:MOST_PAIRS]:
            listed.add_row(one, other, f"{cosine:.4f}")
        out.print(listed)
        if len(pairs) > MOST_PAIRS:
            out.print(f"and {len(pairs) - MOST_PAIRS} more pairs, in {folder / 'plan.json'}", soft_wrap=True)
    out.print(found.sentence(), soft_wrap=True)
    out.print(f"written to {folder}: " + ", ".join(sorted(p.name for p in folder.iterdir())), soft_wrap=True)


def sizes_table(found):
    """The suspects and from what size they would be seen, as a rich table."""
    listed = table("would be seen from this size on", "suspect", "where", "parameter", "seen", "plausible",
                   "share of the strongest")  # fmt: skip
    for v in found.visible:
        share = f"{v.share:.2g}" if v.seen else "not seen"
        listed.add_row(v.suspect.name, v.suspect.where, v.parameter, v.threshold(), v.plausible(), share)
    return listed
