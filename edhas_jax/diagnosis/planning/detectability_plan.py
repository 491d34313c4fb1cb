"""Detectability of effects by a planned campaign: thresholds, indistinguishable pairs, and the next run to add."""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.diagnosis.candidates.candidate import candidates_for
from edhas_jax.diagnosis.planning.candidate_runs import feasible_runs, format_conditions
from edhas_jax.diagnosis.planning.detection_threshold import (
    DETECTION_NORM,
    Detectability,
    detectability_of,
    strength_points,
)
from edhas_jax.diagnosis.planning.planned_campaign import with_predicted_signals
from edhas_jax.diagnosis.planning.signature_gram import CandidatePoints, SignatureGram, cosines
from edhas_jax.inference.fit.fit_problem import calibration_problem
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.checks.campaign_checks import checked_campaign
from edhas_jax.measurements.instruments import Instruments
from edhas_jax.measurements.measurement_model import MeasurementModel
from edhas_jax.measurements.time_resolution import choose_time_resolution

FILE_VERSION = 1
INDISTINGUISHABLE_COSINE = 0.95  # of two unexplained signatures

Pair = tuple[str, str, float]  # two candidates and the cosine of their signatures


@dataclasses.dataclass(frozen=True)
class NextRun:
    """The additional run with the largest benefit.

    Attributes:
        run: its conditions and sampling, without signals.
        conditions: the conditions as text with units.
        indistinguishable: the pairs that remain indistinguishable with this run.
        newly_detectable: names of the candidates that only this run makes detectable.
    """

    run: BenchRun
    conditions: dict[str, str]
    indistinguishable: tuple[Pair, ...]
    newly_detectable: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class DetectabilityPlan:
    """What the runs of a campaign that serve a fit could reveal about k candidates.

    Attributes:
        campaign: the campaign with predicted signals.
        candidates: thresholds of the candidates, the most easily detected first.
        cosines: cosines of their unexplained signatures in the same order, shape (k, k).
        feasible_run_count: number of feasible candidate runs among which `next_run` was chosen.
        next_run: the best additional run; None if no candidate run is feasible, or the search for it was interrupted.
        interrupted: whether the search for the next run was interrupted.
    """

    campaign: Campaign
    candidates: tuple[Detectability, ...]
    cosines: np.ndarray
    feasible_run_count: int
    next_run: NextRun | None
    interrupted: bool = False

    def indistinguishable_pairs(self) -> list[Pair]:
        """Indistinguishable pairs of detectable candidates, the largest cosine first."""
        return _indistinguishable(self.candidates, self.cosines)

    def sentence(self) -> str:
        """The result in words: how many candidates are detectable and distinguishable, and the best next run."""
        detectable, pairs = sum(s.detectable for s in self.candidates), len(self.indistinguishable_pairs())
        summary = f"{detectable} of {len(self.candidates)} candidates are detectable within their plausible range; "
        if pairs:
            summary += f"{pairs} {'pair' if pairs == 1 else 'pairs'} of them are indistinguishable."
        else:
            summary += "all of them are distinguishable."
        if self.interrupted:
            return f"{summary} The search for the best next run was interrupted."
        if any(run.drives for run in self.campaign.runs):
            return f"{summary} The drives are records, so that no next run is proposed."
        if self.next_run is None:
            return f"{summary} No candidate run is feasible."
        run = ", ".join(f"{n.replace('_', ' ')} {text}" for n, text in self.next_run.conditions.items())
        remaining, new = len(self.next_run.indistinguishable), self.next_run.newly_detectable
        benefits = [f"separates {pairs - remaining} of these pairs"] if remaining < pairs else []
        benefits += [f"makes {', '.join(new)} detectable"] if new else []
        benefit = " and ".join(benefits) or "lowers the thresholds slightly, but changes none of these counts"
        return f"{summary} The best next run of {self.feasible_run_count} feasible ones: {run}; it {benefit}."


@single_threaded_algebra
def plan_detectability(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Callable[[str, float], None] | None = None,
) -> DetectabilityPlan:
    """Predict what the runs and sensors of a campaign could reveal; measured signals are not used.

    Args:
        campaign: runs, channels with their noise, uncertain parameters.
        library: restricts the effects considered to these; by default all that the machine has slots for.
        more: further effects to consider.
        on_progress: called with the name of a stage and the share done.

    Returns:
        Thresholds and cosines of all candidates, and the best additional run.
    """
    report = on_progress or (lambda stage, share: None)
    campaign = checked_campaign(campaign)
    report("choosing the integration step", 0.0)
    known = calibration_problem(campaign).unknowns
    model = MeasurementModel(campaign, campaign.machine, known, campaign.runs)
    steps = choose_time_resolution(model, np.zeros(len(known))).coarse
    campaign = with_predicted_signals(campaign, steps)
    runs = campaign.runs_for(Use.FIT) or campaign.runs
    candidates = candidates_for(campaign, campaign.machine, Instruments(), more, library)
    ladders = [CandidatePoints(c, strength_points(c.unknowns(campaign))) for c in candidates]
    gram = SignatureGram(campaign, runs, ladders, steps, lambda stage, share: report(stage, 0.7 * share))
    unexplained = gram.unexplained()
    norms = np.where(gram.failed, np.nan, np.sqrt(np.diag(unexplained)))
    ends = np.cumsum([len(one.points) for one in ladders])
    found = [
        detectability_of(one.candidate, one.points, norm, campaign)
        for one, norm in zip(ladders, np.split(norms, ends[:-1]), strict=True)
    ]
    # the signature of each candidate at the point next to its threshold represents it
    index = [
        int(end) - len(one.points) + int(np.argmax((one.points == f.x).all(axis=1)))
        for one, f, end in zip(ladders, found, ends, strict=True)
    ]
    overlap = cosines(unexplained)[np.ix_(index, index)]
    order = np.argsort([f.threshold_share for f in found], kind="stable")
    found, overlap = [found[k] for k in order], overlap[np.ix_(order, order)]
    report("feasible candidate runs", 0.7)
    feasible, next_run, interrupted = (), None, False
    try:
        feasible = feasible_runs(campaign, campaign.machine, steps)
        if feasible:
            points = [CandidatePoints(f.candidate, f.x[None]) for f in found]
            gram = SignatureGram(
                campaign, (*runs, *feasible), points, steps, lambda stage, share: report(stage, 0.7 + 0.3 * share)
            )
            next_run = _best_next_run(campaign, found, gram, len(runs), feasible)
    except KeyboardInterrupt:  # the sizes are known; they are not lost with the search
        interrupted = True
    return DetectabilityPlan(campaign, tuple(found), overlap, len(feasible), next_run, interrupted)


def _indistinguishable(candidates, overlap: np.ndarray, among: np.ndarray | None = None) -> list[Pair]:
    """Pairs above the limit of the cosine, among the candidates marked in `among` or the detectable ones."""
    among = np.array([s.detectable for s in candidates]) if among is None else among
    rows, columns = np.nonzero(np.triu((overlap > INDISTINGUISHABLE_COSINE) & np.outer(among, among), 1))
    pairs = [
        (candidates[i].candidate.name, candidates[j].candidate.name, float(overlap[i, j]))
        for i, j in zip(rows, columns, strict=True)
    ]
    return sorted(pairs, key=lambda pair: -pair[2])


def _best_next_run(
    campaign: Campaign, candidates, gram: SignatureGram, planned: int, feasible: tuple[BenchRun, ...]
) -> NextRun:  # fmt: skip
    """The feasible run that leaves the fewest indistinguishable pairs and the smallest sum of their cosines.

    Ties are broken by the number of newly detectable candidates and the mean logarithm of all norms. The first
    `planned` runs of `gram` are those of the campaign, the others the feasible runs.
    """
    base = gram.per_run[:planned].sum(axis=0)
    detectable = np.array([s.detectable for s in candidates])
    similar = cosines(gram.project(base)) > INDISTINGUISHABLE_COSINE
    similar = np.triu(np.outer(detectable, detectable) & similar, 1)
    best, lowest_cost = None, (math.inf, math.inf)
    for k, run in enumerate(feasible):
        unexplained = gram.project(base + gram.per_run[planned + k])
        norm, overlap = np.sqrt(np.diag(unexplained)), cosines(unexplained)
        remaining = overlap[similar]
        undetected = ~detectable & (norm > 0.0)
        cost = (
            float((remaining > INDISTINGUISHABLE_COSINE).sum() + remaining.sum()),
            -float((norm[undetected] > DETECTION_NORM).sum()) - float(np.log(np.maximum(norm, 1e-9)).mean()),
        )
        if cost < lowest_cost:
            new = undetected & (norm > DETECTION_NORM)
            names = tuple(s.candidate.name for s, is_new in zip(candidates, new, strict=True) if is_new)
            pairs = tuple(_indistinguishable(candidates, np.where(similar, overlap, 0.0), detectable))
            best, lowest_cost = NextRun(run, format_conditions(campaign, run.conditions), pairs, names), cost
    return best


def plan_as_json(plan: DetectabilityPlan) -> dict[str, Any]:
    """The content of `plan.json`; sizes in SI."""
    visible = [
        {
            "effect": s.candidate.id, "signal": s.candidate.signal, "slot": s.candidate.location,
            "parameter": s.parameter, "seen": s.detectable, "size": s.threshold if math.isfinite(s.threshold) else None,
            "absent": s.absent_value if math.isfinite(s.absent_value) else None,
            "unit": s.unit if s.unknown else "",
            "share_of_strongest": s.threshold_share if math.isfinite(s.threshold_share) else None,
        }
        for s in plan.candidates
    ]  # fmt: skip
    next_run = plan.next_run
    return {
        "version": FILE_VERSION,
        "campaign": plan.campaign.name,
        "visible": visible,
        "not_told_apart": [list(pair) for pair in plan.indistinguishable_pairs()],
        "next_run": None if next_run is None else {
            "conditions": next_run.conditions, "chosen_from": plan.feasible_run_count,
            "becomes_visible": list(next_run.newly_detectable),
            "not_told_apart": [list(pair) for pair in next_run.indistinguishable],
        },
        "interrupted": plan.interrupted,
        "sentence": plan.sentence(),
    }  # fmt: skip
