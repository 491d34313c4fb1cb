"""What makes the mean flow drop above 30 Hz? The causes that the paper names, tested on one machine.

    python -m studies.flow_drop [--quick] [--out FOLDER]

Trapped air, late valves, warm oil, a starved suction line and the supply are each put into a machine whose flow does
not drop, at the size at which the mean flow comes nearest to the statement of the paper. The causes that can explain
the drop are then compared: whether they are distinguishable by the mean flow over frequency, alone and with one more
signal, after a refit of all uncertain parameters; by which single run they are distinguished best; and what a diagnosis
finds on benches with a cause, from runs at 10 Hz alone and with faster ones. `--quick` leaves the diagnoses out.
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
from studies.flow_drop.causes import CAUSES, SizedCause, base_machine, find_sizes
from studies.flow_drop.discrimination import (
    MEAN_FLOW,
    MIN_DISTANCE,
    READINGS,
    RUNS_TO_30_HZ,
    RUNS_TO_45_HZ,
    CauseModel,
    DecisiveRun,
    Discrimination,
    discriminate,
    rank_runs,
)
from studies.flow_drop.figures import draw_distances, draw_flows, draw_signals

PEAK_ONLY = "low supply voltage"  # the flow peaks at 30 Hz but falls at no size; compared with the others as well
CURVES = {"mean flow to 45 Hz": RUNS_TO_45_HZ, "mean flow to 30 Hz": RUNS_TO_30_HZ}  # {range of the measurements: runs}
DIAGNOSED_CAUSES = ("late valves", "narrow suction line")  # not distinguishable by runs at 10 Hz


def main(arguments: list[str] | None = None) -> dict[str, object]:
    """Size and compare the causes, find the decisive run, diagnose; print tables and write figures."""
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
            found.append(find_sizes(base, cause))
    console.print(cause_table(found))
    explaining = [sizes[0] for sizes in found if sizes[0].explains_fall]
    rivals = [*explaining, *(s for sizes in found for s in sizes if s.cause.title == PEAK_ONLY and s.peaks_near_30_hz)]
    with console.status("") as status:
        suspects = [CauseModel(base, s) for s in rivals]
        discriminations = {name: discriminate(suspects, runs, status.update) for name, runs in CURVES.items()}
        status.update("looking for the run that settles it")
        runs = rank_runs([s for s in suspects if s.title != PEAK_ONLY])
    console.print(distance_table(discriminations))
    console.print(run_table(runs))
    best = runs[0]
    drawn = {
        "fall_causes": draw_flows(base, found), "fall_parting": draw_distances(discriminations),
        "fall_signals": draw_signals(base, explaining, best.run),
    }  # fmt: skip
    for name, figure in drawn.items():
        figure.savefig(options.out / f"{name}.png", dpi=110)
    console.print(f"pictures: {', '.join(f'{name}.png' for name in drawn)} in {options.out}", soft_wrap=True)
    if not options.quick:
        print_diagnoses(base, [s for s in explaining if s.cause.title in DIAGNOSED_CAUSES], console)
    return last_line(explaining, discriminations, best)


def cause_table(found: list[list[SizedCause]]) -> Table:
    """Each cause at the size that explains the drop, else at the strong end of its range and at the size that would."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    ratios = "top,\nHz", "20 Hz\n/2×10", "30 Hz\n/free", "45 Hz\n/top"
    for head in ("cause", "published range", "size", "falls for, SI", *ratios, ""):
        table.add_column(head, justify="right" if head in ("size", *ratios) else "left", no_wrap=True)
    for sizes in found:
        for k, s in enumerate(sizes):
            cause = s.cause
            low, high = (cause.size_text(v) for v in sorted(cause.plausible))
            span = f"{low.removesuffix(high.partition(' ')[2]).rstrip()} … {high}"
            falling = " … ".join(f"{v:.3g}" for v in s.falling_sizes) if s.falling_sizes else ""
            verdict = "falls" if s.falls else "bends" if s.peaks_near_30_hz else "does not fall"
            outside = "" if cause.is_plausible(s.size) else ",\nbeyond range"
            peak = "none" if s.peak_frequency != s.peak_frequency else f"{s.peak_frequency:.0f}"
            table.add_row(
                cause.title if k == 0 else "", span if k == 0 else "", cause.size_text(s.size), falling, peak,
                f"{s.proportionality:.3f}", f"{s.relative_flow:.3f}", f"{s.remaining_flow:.2f}", verdict + outside,
            )  # fmt: skip
    return table


def distance_table(discriminations: dict[str, Discrimination]) -> Table:
    """The distance of each pair by the measured signals, for both frequency ranges."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="distance in σ, all refitted", title_justify="left")
    for head in ("", *(_label(n) for n in READINGS)):
        table.add_column(head, justify="right" if head else "left")
    for name, discrimination in discriminations.items():
        table.add_row(f"[bold]{name}[/]")
        for pair in discrimination.pairs(MEAN_FLOW):
            values = (discrimination.pairs(n)[pair] for n in READINGS)
            table.add_row("  " + " | ".join(pair), *(f"{v:.1f}" + ("" if v > MIN_DISTANCE else " no") for v in values))
    return table


def run_table(runs: list[DecisiveRun]) -> Table:
    """For each signal the run with the largest distance of the nearest pair."""
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, title="one run, one signal", title_justify="left")
    for head in ("signal", "run", "nearest pair, σ"):
        table.add_column(head, justify="right" if "σ" in head else "left")
    for name in READINGS:
        best = next(s for s in runs if s.reading == name)
        table.add_row(_label(name), _run(best), f"{best.distance:.1f}")
    return table


def _label(name: str) -> str:
    return name.removesuffix("_a").replace("_", " ")


def _run(s: DecisiveRun) -> str:
    return f"{s.run.frequency:g} Hz, {1e3 * s.run.amplitude:g} mm"


def print_diagnoses(base: PumpBench, causes: list[SizedCause], console: Console) -> None:
    """Print the results of `plan` and `diagnose` for benches with a cause."""
    with console.status("planning") as status:
        first = fall_diagnosis.plan_from_10_hz(base)
        console.print(f"plan, as the paper measured, 10 Hz: {first.sentence()}", soft_wrap=True)
        second = fall_diagnosis.plan_from_10_hz(base, fall_diagnosis.CHANNELS_WITH_CHAMBER)
        thresholds = _line_threshold(first), _line_threshold(second)
        console.print("smallest line seen: {}; with chamber pressure: {}".format(*thresholds), soft_wrap=True)
        answers = [
            fall_diagnosis.diagnose_bench(base, s, stage, on_progress=status.update)
            for s in causes for stage in fall_diagnosis.stages(first)
        ]  # fmt: skip
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    at = f"flow at {fall_diagnosis.PREDICTED_FREQUENCY:g} Hz,\nL/min, predicted / true"
    for head in ("cause", "measured", "verdict", "missing", "damping,\nN·s/m, found / true", at):
        table.add_column(head)
    for a in answers:
        verdict = a.diagnosis.verdict.value.replace("_", " ")
        table.add_row(a.cause, a.stage, verdict, a.found, *(f"{v[0]:.3g} / {v[1]:.3g}" for v in (a.damping, a.flow)))
    console.print(table)


def _line_threshold(found: DetectabilityPlan) -> str:
    line = next(v for v in found.candidates if v.candidate.kind is SuctionLineResistance)
    return line.threshold_text() or "none"


def last_line(
    explaining: list[SizedCause], discriminations: dict[str, Discrimination], best: DecisiveRun
) -> dict[str, object]:
    """Print and return the result as key=value; counts are for runs up to 30 Hz unless the key says otherwise."""
    far, near = discriminations.values()
    pairs = len(far.pairs(MEAN_FLOW))
    counts = {n: f"{near.distinguishable_pairs(n)}/{pairs}" for n in READINGS}
    summary = {
        "causes_that_fall": len(explaining),
        "parted_by_flow_to_45_hz": f"{far.distinguishable_pairs(MEAN_FLOW)}/{pairs}",
        "parted_by_flow": counts[MEAN_FLOW],
        "parted_with_piston": counts["piston_position"], "parted_with_pressure": counts["outlet_pressure"],
        "settled_by": f"{best.reading}@{best.run.frequency:g}Hz_{1e3 * best.run.amplitude:g}mm",
        "settled_at_sigma": round(best.distance, 1),
    }  # fmt: skip
    print(" ".join(f"{n}={v}" for n, v in summary.items()))
    return summary
