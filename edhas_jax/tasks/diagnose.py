"""Diagnose: which effect the model of a campaign's machine lacks, and of what size."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from edhas_jax.core.optional_parts import OptionalParts
from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.trusted_code import Trust
from edhas_jax.design.sweep.dask_cluster import dask_executor
from edhas_jax.diagnosis.planning import next_experiment as planning
from edhas_jax.diagnosis.report.bench_findings import bench_rows
from edhas_jax.diagnosis.report.conclusions import conclusions, explains_little, outcome, parameters_text
from edhas_jax.diagnosis.report.overview_figure import draw_overview
from edhas_jax.diagnosis.report.report import diagnosis_report, write_report
from edhas_jax.diagnosis.report.result_file import CALIBRATED_CONFIG_FILE, CALIBRATED_FILE, save_diagnosis
from edhas_jax.diagnosis.search.checkpoint import Checkpoint, program_versions
from edhas_jax.diagnosis.search.diagnose import diagnose as search
from edhas_jax.diagnosis.search.result import Diagnosis, Verdict
from edhas_jax.inference.fit.fit_problem import FitError
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.measurements.campaign import Campaign, CampaignError, Use
from edhas_jax.measurements.campaign_reader import as_campaign
from edhas_jax.measurements.checks.data_summary import data_sentences
from edhas_jax.tasks.compare import errors_table
from edhas_jax.tasks.result import Result, save_figure, with_methods

MAX_BENCH_ROWS, MAX_SET_ROWS = 10, 6  # deviations of the bench and sets in the summary; the report lists more
INTERRUPTED = "Interrupted: the result is written, but not all of its pictures; the same command makes them."
VERDICT_TONES = {Verdict.ADEQUATE: Tone.GOOD, Verdict.MISSING_EFFECT: Tone.HEAD}


@dataclasses.dataclass(frozen=True, repr=False)
class DiagnosisResult(Result, Diagnosis):
    """What the model of a campaign's machine lacks; see `Diagnosis` for its numbers."""

    # besides the model, curves as tabulated laws that it names
    files = (
        "report.html", "diagnosis.json", "diagnosis.png", "config.yaml", CALIBRATED_CONFIG_FILE, CALIBRATED_FILE,
        "*_deviation.yaml", "*_curve_over_*.yaml",
    )  # fmt: skip

    @property
    def machine(self):
        """The machine with the effects that were found, everything fitted."""
        return self.final.machine

    def summary(self) -> Summary:
        """See `Result.summary`."""
        verdict = self.verdict.value.replace("_", " ") + (", most is left" if explains_little(self) else "")
        title = f"{self.campaign.name}: {verdict}, {self.seconds:.0f} s"
        found = conclusions(self)
        tone = VERDICT_TONES.get(self.verdict, Tone.CAUTION)
        sentences = [Toned(s, tone) if s == found[0] else s for s in data_sentences(self.campaign, found)]
        bench = [self._bench()] if bench_rows(self.after) else []
        return Summary(title, (*bench, self._sets(), self._candidates(), errors_table(self.errors()), *sentences))

    def summary_with(self, experiment: Any, failures: Sequence[str]) -> Summary:
        """The summary with the recommended run and sentences on what could not be made."""
        summary = self.summary()
        more = [] if experiment is None else [experiment.sentence]
        return dataclasses.replace(summary, parts=(*summary.parts, *more, *failures))

    def _bench(self) -> SummaryTable:
        rows = bench_rows(self.after)[:MAX_BENCH_ROWS]
        return SummaryTable.of("bench", ("what", "run", "deviation", "accuracy"), rows, title="what the bench did")

    def _sets(self) -> SummaryTable:
        rows, records, near = [], [], {of.key for of in self.posterior.near}
        for of, weight in list(zip(self.posterior.sets, self.posterior.weights, strict=True))[:MAX_SET_ROWS]:
            errors = [of.evaluated.rms_over_noise(use) for use in Use]
            fitted, new = (f"{e:.3f}" if math.isfinite(e) else "none is held out" for e in errors)
            texts = str(of), f"{weight:.2f}", fitted, new
            rows.append(texts if of.key in near else [Toned(text, Tone.QUIET) for text in texts])
            records.append({
                "set": [c.name for c in of.members], "probability": weight, "residual_over_noise": errors[0],
                "residual_over_noise_on_new_runs": errors[1],
            })  # fmt: skip
        columns = "set of effects", "probability", "residual over noise", "on new runs"
        return SummaryTable.of("sets", columns, rows, records, "sets")

    def _candidates(self) -> SummaryTable:
        rows, records = [], []
        for candidate, p in self.posterior.candidates():
            fit = self.fit_of_parameters(candidate)
            values = {n: fit.values[u.name] for n, u in candidate.own_unknowns(fit.problem.unknowns).items()}
            rms = self.model_with(candidate).rms_over_noise(Use.HOLDOUT)
            new_runs = f"{rms:.3f}" if math.isfinite(rms) else "none is held out"
            said = outcome(self, candidate)
            sizes = parameters_text(self, candidate)
            texts = candidate.name, said.value, candidate.location, sizes, f"{p:.2f}", new_runs
            rows.append([Toned(text, Tone.QUIET) for text in texts] if said.is_quiet else texts)
            records.append({"effect": candidate.name, "outcome": said.value, "where": candidate.location,
                            "size": values, "probability": p, "residual_over_noise_on_new_runs": rms})  # fmt: skip
        columns = "effect", "outcome", "where", "size", "probability", "new runs, residual over noise"
        return SummaryTable.of("candidates", columns, rows, records, "candidates")

    def plot(self):
        """Plot run, suspects, the run with the effects that were found, and the errors, as a matplotlib figure."""
        return draw_overview(self)

    def next_experiment(self):
        """The most informative next run, an `Experiment` with a `sentence`; None if there is none."""
        return planning.next_experiment(self)

    def report(self) -> str:
        """The report, one HTML page."""
        return diagnosis_report(self)

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        return self.write_all(folder)[1]

    def write_all(
        self, folder: Path, failures: Sequence[str] = (), on_progress: Callable[[str], None] | None = None
    ) -> tuple[Any, list[str], bool]:
        """Write result, model, report and picture into an existing folder: what may fail last.

        Args:
            folder: an existing folder.
            failures: sentences on parts that could not be made before.
            on_progress: called with a sentence before each stage.

        Returns:
            The next experiment or None, a sentence on each part that failed, and whether the user has interrupted it.
        """
        optional, interrupted, experiment = OptionalParts(), False, None
        optional.failures += failures
        say, path = on_progress or (lambda sentence: None), folder / "report.html"
        save_diagnosis(self, folder)
        try:
            say("writing the report")
            optional.attempt("The report", lambda: write_report(self, path, pictures=False))
            say("looking for the most informative next run")
            experiment = optional.attempt("The next experiment", self.next_experiment)
            say("drawing the pictures")
            optional.attempt("diagnosis.png", lambda: save_figure(self.plot(), folder / "diagnosis.png"))
            with_pictures = functools.partial(write_report, self, path, experiment, optional.failures)
            optional.failures += optional.attempt("The report with pictures", with_pictures) or []
        except KeyboardInterrupt:
            optional.failures.append(INTERRUPTED)
            interrupted = True
        save_diagnosis(self, folder, None if experiment is None else experiment.as_json(), optional.failures)
        return experiment, optional.failures, interrupted


def diagnose(
    campaign: Campaign | Path | str,
    effects: Iterable[type[Effect] | str] = (),
    library: Iterable[type[Effect]] | None = None,
    trust: Trust = (),
    on_progress: Callable[[str], None] | None = None,
    checkpoint: Checkpoint | None = None,
    cluster: str | None = None,
) -> DiagnosisResult:
    """Find the effects that the model of a campaign's machine lacks.

    Args:
        campaign: a campaign or its folder.
        effects: further effects to consider: classes, or "FILE.py:Class", which may then run.
        library: restricts the library to these effects; None: all that the machine has slots for.
        trust: Python files of your own that may run if the campaign names them.
        on_progress: called with a sentence on the work at hand.
        checkpoint: keeps finished stages, so that an interrupted search goes on.
        cluster: "local:4" for four processes on this machine, or the address of a Dask scheduler, for independent
            fits; None: this process.

    Returns:
        The verdict, the sets of effects with their probabilities, and the final model.

    Raises:
        CampaignError: the campaign is wrong, the fit fails, or the workers were lost.
        ClusterError: the cluster cannot be reached or used.
    """
    more = [load_effect(e, trust=[e]) if isinstance(e, str) else e for e in effects]
    options = {"more": more, "on_progress": on_progress, "checkpoint": checkpoint}
    options |= {} if library is None else {"library": library}
    with dask_executor(cluster, program_versions) as executor:
        try:
            found = search(as_campaign(campaign, trust), executor=executor, **options)
        except FitError as error:
            raise CampaignError(str(error)) from None
    return with_methods(DiagnosisResult, found)
