"""Plan: before any test, what the runs and sensors of a campaign could reveal."""

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from edhas_jax.config.run_folder import write_json
from edhas_jax.core.optional_parts import OptionalParts
from edhas_jax.core.summary import Summary, SummaryTable
from edhas_jax.core.trusted_code import Trust
from edhas_jax.core.units import to_si
from edhas_jax.diagnosis.planning.detectability_plan import DetectabilityPlan, plan_as_json, plan_detectability
from edhas_jax.diagnosis.planning.figures import draw_similarity, draw_thresholds
from edhas_jax.diagnosis.planning.planned_campaign import read_planned_campaign
from edhas_jax.machine.effects import Effect
from edhas_jax.machine.effects.loading import load_effect
from edhas_jax.measurements.campaign import Campaign
from edhas_jax.tasks.result import Result, save_figure, with_methods

MAX_SHOWN_PAIRS = 12


@dataclasses.dataclass(frozen=True, repr=False)
class PlanResult(Result, DetectabilityPlan):
    """Which effects the runs of a campaign can detect, and of what size; the numbers are in `DetectabilityPlan`."""

    files = ("plan.json", "sizes.png", "overlaps.png")

    def summary(self) -> Summary:
        """See `Result.summary`."""
        pairs = self.indistinguishable_pairs()
        parts = [self._sizes()]
        if pairs:
            columns = "one", "other", "how alike (1: the same)"
            rows = [(one, other, f"{cosine:.4f}") for one, other, cosine in pairs[:MAX_SHOWN_PAIRS]]
            records = [dict(zip(("one", "other", "cosine"), pair, strict=True)) for pair in pairs]
            title = "detectable, but not distinguishable"
            parts.append(SummaryTable.of("indistinguishable", columns, rows, records, title))
        if len(pairs) > MAX_SHOWN_PAIRS:
            parts.append(f"and {len(pairs) - MAX_SHOWN_PAIRS} more pairs, in plan.json")
        title = f"{self.campaign.name}: {len(self.candidates)} candidates, {len(self.campaign.runs)} runs"
        return Summary(title, (*parts, self.sentence()))

    def _sizes(self) -> SummaryTable:
        columns = "candidate", "where", "parameter", "detectable from", "plausible", "share of the strongest"
        rows, records = [], []
        for s in self.candidates:
            share = f"{s.threshold_share:.2g}" if s.detectable else "not detectable"
            name, where = s.candidate.name, s.candidate.location
            rows.append((name, where, s.parameter, s.threshold_text(), s.plausible_text(), share))
            records.append({
                "candidate": name, "where": where, "parameter": s.parameter, "unit": s.unit if s.unknown else "",
                "detectable_from": s.threshold, "share_of_strongest": s.threshold_share, "detectable": s.detectable,
            })  # fmt: skip
        return SummaryTable.of("sizes", columns, rows, records, "smallest detectable size")

    def plot(self):
        """Plot the smallest detectable size of each candidate, as a matplotlib figure."""
        return draw_thresholds(self)

    def plot_overlaps(self):
        """Plot which candidates look alike to these runs, as a matplotlib figure."""
        return draw_similarity(self)

    def write_files(self, folder: Path) -> Sequence[str]:
        """See `Result.write_files`."""
        optional = OptionalParts()
        write_json(folder / "plan.json", plan_as_json(self))
        for name, draw in (("sizes.png", self.plot), ("overlaps.png", self.plot_overlaps)):
            optional.attempt(name, lambda name=name, draw=draw: save_figure(draw(), folder / name))
        return optional.failures


def plan(
    campaign: Campaign | Path | str,
    rate: float | str = 5000.0,
    effects: Iterable[type[Effect] | str] = (),
    library: Iterable[type[Effect]] | None = None,
    trust: Trust = (),
    on_progress: Callable[[str, float], None] | None = None,
) -> PlanResult:
    """Predict which effects a planned campaign can detect and distinguish, and the most useful next run.

    Args:
        campaign: a campaign or its folder; its runs need no files yet.
        rate: sampling of runs without a file [Hz], or a text with unit.
        effects: further effects to consider: classes, or "FILE.py:Class", which may then run.
        library: restricts the effects considered; None: all that the machine has slots for.
        trust: Python files of your own that may run if the campaign names them.
        on_progress: called with the name of a stage and the share done.

    Raises:
        CampaignError: the campaign is wrong.
        UnitError: `rate` is a text that is no frequency.
    """
    rate = to_si(rate, "Hz", "5 kHz") if isinstance(rate, str) else float(rate)
    more = [load_effect(e, trust=[e]) if isinstance(e, str) else e for e in effects]
    if not isinstance(campaign, Campaign):
        campaign = read_planned_campaign(campaign, rate, trust)
    return with_methods(PlanResult, plan_detectability(campaign, library, more, on_progress))
