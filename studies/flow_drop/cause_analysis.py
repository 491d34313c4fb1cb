"""What makes the mean flow fall above 30 Hz? What the paper blames and never tests, tested on one machine.

    python -m studies.flow_drop [--quick] [--out FOLDER]

Trapped air, late valves, warm oil, starved suction and the supply are each put into a machine in which nothing falls,
at the size at which the mean flow comes nearest to the paper's statement. Those that can do it are then told apart: by
the mean flow over frequency alone, and with one more signal, all that is uncertain fitted anew; the single run that
settles it is named; and benches that have a cause are diagnosed from runs at 10 Hz alone, and with faster ones.
`--quick` leaves the diagnoses out.
"""

import argparse
from pathlib import Path

from rich import box
from rich.console import Console
from rich.table import Table

from edhas_jax.diagnosis.planning.detectability_plan import DetectabilityPlan
from edhas_jax.machine.effects import SuctionLineResistance
from edhas_jax.machine.rigs import PumpBench
from studies.flow_drop import diagnosis as fall_diagnosis
from studies.flow_drop.causes import CAUSES, Sized, base_machine, sizes_of
from studies.flow_drop.discrimination import (
    CLEAR,
    CURVE,
    MEAN_FLOW,
    READINGS,
    TO_THE_KNEE,
    Parting,
    Settling,
    Suspected,
    part,
    settling,
)
from studies.flow_drop.pictures import draw_flows, draw_parting, draw_signals

BENT = "low supply voltage"  # falls at no size, but bends the curve at 30 Hz: told apart from the others all the same
CURVES = {"mean flow to 45 Hz": CURVE, "mean flow to 30 Hz": TO_THE_KNEE}  # how far it is measured
ALIKE = ("late valves", "narrow suction line")  # runs at 10 Hz do not tell them apart


def main(arguments: list[str] | None = None) -> dict[str, object]:
    """Size the causes, part them, name the run, diagnose; print tables, leave pictures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="without the diagnoses")
    parser.add_argument("--out", type=Path, default=Path("runs/fall_over_frequency"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    console = Console(highlight=False, width=120)
    base = base_machine()
    with console.status("") as status:
        found = []
        for cause in CAUSES:
            status.update(f"sizing: {cause.title}")
            found.append(sizes_of(base, cause))
    console.print(cause_table(found))
    guilty = [sizes[0] for sizes in found if sizes[0].guilty]
    rivals = [*guilty, *(s for sizes in found for s in sizes if s.cause.title == BENT and s.bends)]
    with console.status("") as status:
        suspects = [Suspected(base, s) for s in rivals]
        partings = {told: part(suspects, runs, status.update) for told, runs in CURVES.items()}
        status.update("looking for the run that settles it")
        runs = settling([s for s in suspects if s.title != BENT])
    console.print(parting_table(partings))
    console.print(settling_table(runs))
    best = runs[0]
    drawn = {
        "fall_causes": draw_flows(base, found), "fall_parting": draw_parting(partings),
        "fall_signals": draw_signals(base, guilty, best.run),
    }  # fmt: skip
    for name, figure in drawn.items():
        figure.savefig(options.out / f"{name}.png", dpi=110)
    console.print(f"pictures: {', '.join(f'{name}.png' for name in drawn)} in {options.out}", soft_wrap=True)
    if not options.quick:
        diagnosed(base, [s for s in guilty if s.cause.title in ALIKE], console)
    return last_line(guilty, partings, best)


def cause_table(found: list[list[Sized]]) -> Table:
    """Every cause at the size that does it, or at the strong end of its range and where it would."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    ratios = "top,\nHz", "20 Hz\n/2×10", "30 Hz\n/free", "45 Hz\n/top"
    for head in ("cause", "published range", "size", "falls for, SI", *ratios, ""):
        table.add_column(head, justify="right" if head in ("size", *ratios) else "left", no_wrap=True)
    for sizes in found:
        for k, s in enumerate(sizes):
            cause = s.cause
            low, high = (cause.told(v) for v in sorted(cause.plausible))
            span = f"{low.removesuffix(high.partition(' ')[2]).rstrip()} … {high}"
            between = " … ".join(f"{v:.3g}" for v in s.between) if s.between else ""
            verdict = "falls" if s.falls else "bends" if s.bends else "does not fall"
            outside = "" if cause.believable(s.size) else ",\nbeyond range"
            knee = "none" if s.knee != s.knee else f"{s.knee:.0f}"
            table.add_row(
                cause.title if k == 0 else "", span if k == 0 else "", cause.told(s.size), between, knee,
                f"{s.proportion:.3f}", f"{s.filling:.3f}", f"{s.kept:.2f}", verdict + outside,
            )  # fmt: skip
    return table


def parting_table(partings: dict[str, Parting]) -> Table:
    """The distance of every pair by what is measured, on both benches."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="distance in σ, all refitted", title_justify="left")
    for head in ("", *(_told(n) for n in READINGS)):
        table.add_column(head, justify="right" if head else "left")
    for told, parting in partings.items():
        table.add_row(f"[bold]{told}[/]")
        for pair in parting.pairs(MEAN_FLOW):
            values = (parting.pairs(n)[pair] for n in READINGS)
            table.add_row("  " + " | ".join(pair), *(f"{v:.1f}" + ("" if v > CLEAR else " no") for v in values))
    return table


def settling_table(runs: list[Settling]) -> Table:
    """For every signal the run that parts the nearest pair most."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="one run, one signal", title_justify="left")
    for head in ("signal", "run", "nearest pair, σ"):
        table.add_column(head, justify="right" if "σ" in head else "left")
    for name in READINGS:
        best = next(s for s in runs if s.reading == name)
        table.add_row(_told(name), _run(best), f"{best.distance:.1f}")
    return table


def _told(name: str) -> str:
    return name.removesuffix("_a").replace("_", " ")


def _run(s: Settling) -> str:
    return f"{s.run.frequency:g} Hz, {1e3 * s.run.amplitude:g} mm"


def diagnosed(base: PumpBench, causes: list[Sized], console: Console) -> None:
    """Print what `plan` and `diagnose` say of benches that have a cause."""
    with console.status("planning") as status:
        first = fall_diagnosis.before_any_test(base)
        console.print(f"plan, as the paper measured, 10 Hz: {first.sentence()}", soft_wrap=True)
        second = fall_diagnosis.before_any_test(base, fall_diagnosis.AND_CHAMBER)
        console.print(f"smallest line seen: {_seen(first)}; with chamber pressure: {_seen(second)}", soft_wrap=True)
        answers = [
            fall_diagnosis.ask(base, s, stage, say=status.update)
            for s in causes for stage in fall_diagnosis.stages(first)
        ]  # fmt: skip
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    at = f"flow at {fall_diagnosis.TOLD_AT:g} Hz,\nL/min, told / true"
    for head in ("cause", "measured", "verdict", "missing", "damping,\nN·s/m, found / true", at):
        table.add_column(head)
    for a in answers:
        verdict = a.diagnosis.verdict.value.replace("_", " ")
        table.add_row(a.cause, a.stage, verdict, a.found, *(f"{v[0]:.3g} / {v[1]:.3g}" for v in (a.damping, a.flow)))
    console.print(table)


def _seen(found: DetectabilityPlan) -> str:
    line = next(v for v in found.candidates if v.candidate.kind is SuctionLineResistance)
    return line.threshold_text() or "none"


def last_line(guilty: list[Sized], partings: dict[str, Parting], best: Settling) -> dict[str, object]:
    """The answer as key=value; what is parted is parted by readings up to 30 Hz where nothing else is said."""
    far, near = partings.values()
    pairs = len(far.pairs(MEAN_FLOW))
    counts = {n: f"{near.parted(n)}/{pairs}" for n in READINGS}
    summary = {
        "causes_that_fall": len(guilty), "parted_by_flow_to_45_hz": f"{far.parted(MEAN_FLOW)}/{pairs}",
        "parted_by_flow": counts[MEAN_FLOW],
        "parted_with_piston": counts["piston_position"], "parted_with_pressure": counts["outlet_pressure"],
        "settled_by": f"{best.reading}@{best.run.frequency:g}Hz_{1e3 * best.run.amplitude:g}mm",
        "settled_at_sigma": round(best.distance, 1),
    }  # fmt: skip
    print(" ".join(f"{n}={v}" for n, v in summary.items()))
    return summary
