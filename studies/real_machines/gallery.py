"""What does the plain model of machines that others have measured lack, and what does it predict once that is added?

    python -m studies.real_machines FOLDER [--machines NAME …] [--out FOLDER]

FOLDER holds the records, those of each machine in a folder of its name (silverbox, crane, emps, tanks, mbari; a machine
without one is left out), with the file names of `machines.py`. Steps, as an engineer takes them: the plain model
beside the records, its uncertain numbers fitted (`fit`), the diagnosis with nothing but the library (`diagnose`), and
one effect after the other, written for what the diagnosis has shown (`add`).

The error is the rms of measured − model of one signal, simulated freely from the start of each record, over the
standard deviation of the measured signal; "not used" are records, or parts of one, that no fit has seen.
"""

import argparse
import dataclasses
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, StrMethodFormatter
from rich.console import Console
from rich.table import Table

import edhas_jax as edhas
from edhas_jax.core.plot_style import COLOURS, GREY, INK
from edhas_jax.diagnosis.report.conclusions import conclusions
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, Use
from edhas_jax.measurements.measurement_model import MeasurementModel
from studies.real_machines.machines import MACHINES, RealMachine

STEPS_PER_SAMPLE = 8
SHOWN_SAMPLES, SHOWN_SWINGS = 600, 15  # most samples and swings of a picture, in the part with the largest scatter


class Stage(NamedTuple):
    """A model of a machine: its name, and measured − model of the judged signal by run, SI."""

    name: str
    residuals: dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Story:
    """What was found on one machine.

    Attributes:
        machine: the machine.
        campaign: its records.
        stages: the models, the plain one first.
        said: what the diagnosis says, the verdict first.
        places: components where something is missing, with their probabilities, the largest first.
        sizes: fitted numbers of the added effects.
        remarks: what the check of the data says.
        seconds: computing time.
    """

    machine: RealMachine
    campaign: Campaign
    stages: list[Stage]
    said: list[str]
    places: dict[str, float]
    sizes: list[str]
    remarks: list[str]
    seconds: float

    def error(self, stage: Stage, use: Use) -> float:
        """The error of a stage over the runs of one use, relative to the standard deviation of the signal."""
        runs = self.campaign.runs_for(use)
        left = np.concatenate([stage.residuals[run.name] for run in runs])
        measured = np.concatenate([run.signals[self.machine.signal] for run in runs])
        return float(np.sqrt(np.nanmean(np.square(left))) / np.nanstd(measured))


def residuals_of(campaign: Campaign, machine: Rig, signal: str) -> dict[str, np.ndarray]:
    """Measured − model of a signal by run (samples,), SI, simulated freely."""
    model = MeasurementModel(dataclasses.replace(campaign, machine=machine), machine, (), campaign.runs)
    predicted = model.predict_all_runs(np.zeros(0), STEPS_PER_SAMPLE)
    return {run.name: run.signals[signal] - predicted[r].values[signal] for r, run in enumerate(campaign.runs)}


def study(machine: RealMachine, folder: Path, say) -> Story:
    """Take one machine from its plain model to the model with the engineer's effects."""
    began, campaign = time.perf_counter(), machine.campaign(folder)
    stages = [Stage("plain", residuals_of(campaign, campaign.machine, machine.signal))]
    fitted = edhas.fit(campaign, on_progress=say)
    stages.append(Stage("fitted", residuals_of(campaign, fitted.fit.machine, machine.signal)))
    found = edhas.diagnose(campaign, on_progress=say)
    stages.append(Stage("diagnosed", residuals_of(campaign, found.machine, machine.signal)))
    added = edhas.add(campaign, machine.effects, on_progress=say)
    for model in added.models[1:]:
        fit = model.evaluated.fit
        stages.append(Stage(f"+ {model.effects[-1].name}", residuals_of(campaign, fit.machine, machine.signal)))
    own = {n: u for c in added.models[-1].effects for n, u in c.own_unknowns(fit.problem.unknowns).items()}
    sizes = [f"{name} {fit.text(u.name)}" for name, u in own.items()]
    remarks = [remark.sentence for remark in found.campaign.remarks]
    return Story(machine, campaign, stages, conclusions(found), found.posterior.locations(), sizes, remarks,
                 time.perf_counter() - began)  # fmt: skip


def draw(story: Story) -> Figure:
    """The unused record with the plain, the fitted and the last model; what each leaves; the error of each model."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    signals = figure.add_gridspec(2, 2, width_ratios=(3, 2), height_ratios=(2, 1))
    traces, bars = figure.add_subplot(signals[0, 0]), figure.add_subplot(signals[:, 1])
    left = figure.add_subplot(signals[1, 0], sharex=traces)
    run = story.campaign.runs_for(Use.HOLDOUT)[0]
    measured = run.signals[story.machine.signal]
    part = _liveliest(measured)
    scale = float(np.nanstd(measured))
    traces.plot(run.time[part], measured[part], color=INK, lw=2.2, label="measured")
    for stage, colour in ((story.stages[1], COLOURS[1]), (story.stages[-1], COLOURS[0])):
        values = stage.residuals[run.name][part]
        traces.plot(run.time[part], (measured[part] - values), color=colour, lw=1.2, label=f"model, {stage.name}")
        left.plot(run.time[part], 100.0 * values / scale, color=colour, lw=1.0)
    unit = story.campaign.machine.signals[story.machine.signal].unit
    name = story.machine.signal.replace("_", " ")
    traces.set_ylabel(f"{name}, {unit}" if unit != "-" else name, color=INK)
    traces.set_title(f"{run.name}: not used for any fit", loc="left", fontsize=10, color=INK)
    figure.legend(frameon=False, fontsize=9, loc="outside upper left", ncols=3, handles=traces.lines)
    left.set_ylabel("measured − model, %", color=INK)
    left.set_xlabel("time, s", color=INK)
    left.axhline(0.0, color=GREY, lw=0.8)
    rows = range(len(story.stages))
    for use, colour, marker, label in ((Use.FIT, GREY, "o", "fitted"), (Use.HOLDOUT, COLOURS[0], "s", "not used")):
        values = [100.0 * story.error(stage, use) for stage in story.stages]
        bars.plot(values, rows, marker, color=colour, ms=8, label=label)
        if use is Use.HOLDOUT:
            for row, value in zip(rows, values, strict=True):
                bars.annotate(f"{value:.3g} %", (value, row), xytext=(0, 8), textcoords="offset points", ha="center",
                              fontsize=9, color=INK)  # fmt: skip
    bars.set_xscale("log", subs=[])
    bars.set_xlim(*_decade_parts(story))
    bars.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    bars.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    bars.set_yticks(rows, [stage.name for stage in story.stages], color=INK)
    bars.set_ylim(len(story.stages) - 0.5, -0.5)
    bars.set_xlabel(f"error of {name} over its standard deviation, %", color=INK)
    bars.grid(axis="x", which="both", lw=0.4, alpha=0.5)
    bars.legend(frameon=False, fontsize=9)
    return figure


def _decade_parts(story: Story) -> tuple[float, float]:
    """The ends of the axis of errors [%], each half as far again as the outermost error."""
    errors = [100.0 * story.error(stage, use) for stage in story.stages for use in Use]
    return min(errors) / 1.6, 1.6 * max(errors)


def _liveliest(values: np.ndarray) -> slice:
    """The part of a record that a picture shows: that with the largest scatter."""
    deviations = np.nan_to_num(values - np.nanmean(values))
    squares, crossings = np.square(deviations), np.count_nonzero(np.diff(np.sign(deviations)))
    count = min(SHOWN_SAMPLES, len(values), int(2 * SHOWN_SWINGS * len(values) / max(crossings, 1)))
    sums = np.convolve(squares, np.ones(count), "valid")
    first = int(np.argmax(sums))
    return slice(first, first + count)


def page(stories: dict[str, Story]) -> str:
    """The stories as Markdown, a picture each."""
    parts = []
    for name, story in stories.items():
        machine, rows = story.machine, []
        for stage in story.stages:
            rows.append(f"| {stage.name} | {story.error(stage, Use.FIT):.1%} | {story.error(stage, Use.HOLDOUT):.1%} |")
        where = ", ".join(f"{place} {p:.2f}" for place, p in list(story.places.items())[:3])
        parts.append("\n".join([
            f"## {machine.title}", "", f"![{machine.title}]({name}.png)", "",
            f"- Record: {machine.record}.", f"- Known to be missing: {machine.known}.",
            f"- Chosen because of these records: {machine.chosen}.",
            *(f"- Check of the data: {sentence}" for sentence in story.remarks),
            *(f"- Diagnosis: {sentence}" for sentence in story.said), f"- Where: {where}.",
            f"- Sizes: {', '.join(story.sizes)}.", "",
            f"| model | {machine.signal}, fitted | not used |", "| --- | --- | --- |", *rows, "",
            f"{story.seconds:.0f} s.", "",
        ]))  # fmt: skip
    return "\n".join(parts)


def main(arguments: list[str] | None = None) -> None:
    """Print a table of all machines; write a page with a picture of each."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="holds a folder of records for each machine")
    parser.add_argument("--machines", nargs="+", choices=tuple(MACHINES), default=tuple(MACHINES))
    parser.add_argument("--out", type=Path, default=Path("runs/real_machines"))
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    console, stories = Console(highlight=False, width=150), {}
    for name in (n for n in options.machines if (options.folder / n).is_dir()):
        with console.status(name) as status:
            story = study(MACHINES[name], options.folder / name, lambda text, n=name: status.update(f"{n}: {text}"))
        stories[name] = story
        draw(story).savefig(options.out / f"{name}.png", dpi=130)
        (options.out / "page.md").write_text(page(stories), encoding="utf-8")
        table = Table("model", "error, fitted", "not used", title=f"{story.machine.title}, {story.machine.signal}")
        for stage in story.stages:
            table.add_row(stage.name, *(f"{story.error(stage, use):.2%}" for use in Use))
        console.print(table)
        said = [*story.said[:2], f"known: {story.machine.known}", f"{story.seconds:.0f} s"]
        console.print("\n".join(said), style="dim")
    right = sum(next(iter(s.places), "") in s.machine.places for s in stories.values())
    errors = " ".join(
        f"{name}_{label}={s.error(stage, Use.HOLDOUT):.4f}"
        for name, s in stories.items()
        for label, stage in (("fitted", s.stages[1]), ("last", s.stages[-1]))
    )
    print(f"machines={len(stories)} right_place={right} {errors}")
