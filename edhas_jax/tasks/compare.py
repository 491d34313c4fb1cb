"""Compare: the model beside the measurements of a campaign, and where it fails."""

import dataclasses
import functools
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.config.machine_config import Config, as_config
from edhas_jax.core.literal_text import csv_text
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.trusted_code import Trust
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Campaign, runs_text
from edhas_jax.measurements.campaign_reader import as_campaign
from edhas_jax.measurements.comparison import Comparison
from edhas_jax.measurements.comparison import compare as simulate_and_compare
from edhas_jax.measurements.comparison_figures import draw_traces
from edhas_jax.measurements.comparison_report import comparison_report, draw_matrices, sentences
from edhas_jax.measurements.figures_of_merit import figures_of_merit
from edhas_jax.measurements.fitted_model import BENCH_CORRECTED, bench_corrected_errors, with_values_of_runs
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.replay import Replay
from edhas_jax.measurements.residual_matrix import RESIDUAL
from edhas_jax.measurements.residual_patterns import Pattern, find_patterns
from edhas_jax.tasks.result import Result, with_methods

GOOD_RESIDUAL, BAD_RESIDUAL = 1.15, 3.0  # residual over noise, up to which nothing is missing, and from which much is


@dataclasses.dataclass(frozen=True, repr=False)
class ComparisonResult(Result, Comparison):
    """The comparison of a model with the measurements of a campaign; `Comparison` describes its numbers.

    Attributes:
        bench_corrected: residual over noise by run and signal with the bench corrected, as the fit of the model has
            left it; empty where nothing of the bench was estimated with this model, and with a measured input.
    """

    bench_corrected: Mapping[str, Mapping[str, float]] = dataclasses.field(default_factory=dict)
    files = ("figures.csv", "report.html")

    @functools.cached_property
    def patterns(self) -> list[Pattern]:
        """The patterns in the residuals, the most important first."""
        return find_patterns(self)

    def figures_of_merit(self):
        """A pandas table: errors, gain, phase, delay and whiteness by run and signal."""
        return figures_of_merit(self)

    def summary(self) -> Summary:
        """See `Result.summary`."""
        found = sentences(self.patterns)
        numbered = [f"{number}. {sentence}" for number, sentence in enumerate(found, 1)]
        counted = runs_text(compared.run for compared in self.runs)
        title = f"{self.campaign.name}: model and measurements, {counted}, {len(self.signals)} signals"
        tables = [residual_table(n.replace(" ", "_"), "run", self.signals, m, n) for n, m in self.matrices().items()]
        return Summary(title, (*tables, *(numbered or ["The residuals hold nothing but the noise of the sensors."])))

    def matrices(self) -> dict[str, Mapping[str, Mapping[str, float]]]:
        """Residual over noise by title, run and signal: plain, and with the bench corrected where that is known."""
        found: dict[str, Mapping[str, Mapping[str, float]]] = {RESIDUAL: self.rms_over_noise()}
        return found | ({f"{RESIDUAL} {BENCH_CORRECTED}": self.bench_corrected} if self.bench_corrected else {})

    def plot(self):
        """Plot residual over noise of every run and signal, as a matplotlib figure."""
        return draw_matrices(self, self.matrices())

    def plot_signal(self, signal: str):
        """Plot a signal measured and of the model, with its residual, as a matplotlib figure.

        Raises:
            ValueError: no run has this signal.
        """
        if signal not in self.signals:
            raise ValueError(f"{signal}: no signal of this comparison; there are: {', '.join(self.signals)}")
        return draw_traces(self, signal)

    def report(self) -> str:
        """The report, one HTML page."""
        return comparison_report(self, self.patterns, self.matrices())

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        table = figures_of_merit(self)
        if self.bench_corrected:
            values = [self.bench_corrected.get(run, {}).get(signal) for run, signal in table.index]
            table.insert(1, "residual_over_noise_with_the_bench_corrected", values)
        table.rename(csv_text, level="run").to_csv(folder / "figures.csv")
        (folder / "report.html").write_text(self.report(), encoding="utf-8")
        return ()


def toned_residual(value: float) -> Toned:
    """A residual over noise as text: good where it is noise alone, bad where the model fails."""
    tone = Tone.GOOD if value < GOOD_RESIDUAL else Tone.CAUTION if value < BAD_RESIDUAL else Tone.BAD
    return Toned(f"{value:.2f}", tone)


def residual_table(
    name: str, head: str, columns: Iterable[str], matrix: Mapping[str, Mapping[str, float]], title: str
) -> SummaryTable:
    """A table of residuals over noise by row and column, some of which may be missing."""
    rows = [(n, *("" if c not in row else toned_residual(row[c]) for c in columns)) for n, row in matrix.items()]
    records = [{head: n, **{c: row.get(c) for c in columns}} for n, row in matrix.items()]
    return SummaryTable.of(name, (head, *columns), rows, records, title)


def errors_table(errors: Mapping[str, Mapping[str, Mapping[str, float]]]) -> SummaryTable:
    """Residual over noise by state of the model, use of the runs ("fit", "holdout") and signal, a row per signal."""
    uses = {"fit": "fitted", "holdout": "held out"}
    found = {f"{state}, {called}": by[use] for use, called in uses.items() for state, by in errors.items()}
    signals = next(iter(found.values()))
    matrix = {n: {column: of[n] for column, of in found.items() if n in of} for n in signals}
    return residual_table("residual_over_noise", "signal", found, matrix, "residual over noise")


def compare(
    campaign: Campaign | Path | str,
    machine: Rig | Config | Mapping[str, Any] | Path | str | None = None,
    instruments: Instruments = Instruments(),
    replay: Replay = Replay.SET_POINT,
    trust: Trust = (),
    on_progress: Callable[[str], None] | None = None,
) -> ComparisonResult:
    """Simulate a model as the bench was run, and compare it with the measurements.

    Args:
        campaign: a campaign or its folder.
        machine: the model, a machine, a configuration or its file; None: the campaign's own. Beside the file of a
            fitted model lies what the runs have of their own, which is used too, and its errors with the bench
            corrected.
        instruments: measurement chains that record the signals of the model.
        replay: the input that drives the model.
        trust: Python files of your own that may run if a file names them.
        on_progress: called with a sentence before each stage of the work.

    Returns:
        The residuals of each run, the patterns in them, pictures and a report.

    Raises:
        CampaignError: the campaign is wrong, or no run can be driven by this input.
        ParameterError: the machine lacks a parameter that the runs set.
    """
    model = None if machine is None else as_config(machine, trust).machine
    campaign = as_campaign(campaign, trust)
    file = machine if isinstance(machine, Path | str) else None
    if file is not None:
        campaign = with_values_of_runs(campaign, file)
    found = simulate_and_compare(campaign, model, instruments, replay, on_progress)
    corrected = {} if file is None else bench_corrected_errors(found, file)
    return with_methods(ComparisonResult, found, bench_corrected=corrected)
