"""What a campaign could find before it is made: smallest effects it would show, pairs it cannot part, the next run."""

import dataclasses
import math
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from edhas_jax.diagnosis.planning.candidate_runs import as_modelled, feasible_runs, texts
from edhas_jax.diagnosis.planning.detection_threshold import (
    SEEN,
    Look,
    Products,
    Visible,
    cosines,
    ladder,
    visible_from,
)
from edhas_jax.diagnosis.search.candidates import problem_of, suspects_for, unknowns_of
from edhas_jax.machine.effects import Effect
from edhas_jax.measurements.campaign import BenchRun, Campaign, Use
from edhas_jax.measurements.measurement_chain import Instruments
from edhas_jax.measurements.predicted_signals import Model
from edhas_jax.measurements.step_selection import choose_resolution

VERSION = 1  # of the file
ALIKE = 0.95  # cosine above which two suspects are not told apart


@dataclasses.dataclass(frozen=True)
class NextRun:
    """A run more, and what comes of it: `conditions` as text, pairs still alike, suspects newly seen."""

    run: BenchRun
    conditions: dict[str, str]
    alike: tuple[tuple[str, str, float], ...]
    seen: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class Plan:
    """What the runs of `campaign` that serve a fit could reveal.

    `overlap` (k, k) are the cosines of what is left of the suspects of `visible`, in its order. `tried` counts the
    feasible runs among which `next` was chosen; None where there are none.
    """

    campaign: Campaign
    visible: tuple[Visible, ...]
    overlap: np.ndarray
    tried: int
    next: NextRun | None

    def pairs(self) -> list[tuple[str, str, float]]:
        """Pairs that are seen but not told apart, with their cosine, the worst first."""
        return _pairs(self.visible, self.overlap)

    def sentence(self) -> str:
        """What would be seen, and the next run, in plain words."""
        seen, pairs = sum(v.seen for v in self.visible), len(self.pairs())
        told = f"{seen} of {len(self.visible)} suspects would be seen within their plausible range; "
        alike = f"{pairs} {'pair' if pairs == 1 else 'pairs'} of them would not be told apart."
        told += alike if pairs else "all of them would be told apart."
        if self.next is None:
            return f"{told} No run of the menu is feasible."
        run = ", ".join(f"{n.replace('_', ' ')} {text}" for n, text in self.next.conditions.items())
        gains = [f"parts {pairs - len(self.next.alike)} of these pairs"] if len(self.next.alike) < pairs else []
        gains += [f"makes {', '.join(self.next.seen)} visible"] if self.next.seen else []
        worth = " and ".join(gains) or "shows all suspects a little more clearly, but changes none of this"
        return f"{told} The best next run of {self.tried} feasible ones: {run}; it {worth}."


def plan(
    campaign: Campaign,
    library: Iterable[type[Effect]] | None = None,
    more: Iterable[type[Effect]] = (),
    on_progress: Callable[[str, float], None] | None = None,
) -> Plan:
    """Say what the planned runs and sensors could reveal; nothing measured is looked at.

    `library` restricts the effects that are suspected, `more` adds a user's own. `on_progress` is called with what is
    being done and the share done.
    """
    say = on_progress or (lambda what, share: None)
    say("looking for the step that serves", 0.0)
    known = problem_of(campaign, campaign.machine, Instruments(), ()).unknowns
    model = Model(campaign, campaign.machine, known, campaign.runs)
    steps = choose_resolution(model, np.zeros(len(known))).rough
    campaign = as_modelled(campaign, steps)
    runs = campaign.runs_for(Use.FIT) or campaign.runs
    suspects = suspects_for(campaign, campaign.machine, Instruments(), more)
    if library is not None:
        allowed = {kind.id for kind in (*library, *more)}
        suspects = [s for s in suspects if s.signal is not None or s.id in allowed]
    ladders = [Look(suspect, ladder(unknowns_of(suspect, campaign))) for suspect in suspects]
    first = Products(campaign, runs, ladders, steps, lambda what, share: say(what, 0.7 * share))
    left = first.left()
    lengths = np.where(first.failed, np.nan, np.sqrt(np.diag(left)))
    parts = np.split(lengths, np.cumsum([len(look.points) for look in ladders])[:-1])
    visible = [visible_from(look, length, campaign) for look, length in zip(ladders, parts, strict=True)]
    chosen, at = [], 0
    for look, one in zip(ladders, visible, strict=True):
        chosen.append(at + int(np.argmax((look.points == one.x).all(axis=1))))
        at += len(look.points)
    overlap = cosines(left)[np.ix_(chosen, chosen)]
    order = np.argsort([v.share for v in visible], kind="stable")
    visible, overlap = [visible[k] for k in order], overlap[np.ix_(order, order)]
    say("which runs are feasible", 0.7)
    menu = feasible_runs(campaign, campaign.machine, steps)
    looks = [Look(v.suspect, v.x[None]) for v in visible]
    best = None
    if menu:
        every = Products(campaign, (*runs, *menu), looks, steps, lambda what, share: say(what, 0.7 + 0.3 * share))
        best = _next(campaign, visible, every, len(runs), menu)
    return Plan(campaign, tuple(visible), overlap, len(menu), best)


def _pairs(visible, overlap: np.ndarray, among: np.ndarray | None = None) -> list[tuple[str, str, float]]:
    seen = np.array([v.seen for v in visible]) if among is None else among
    rows, columns = np.nonzero(np.triu((overlap > ALIKE) & np.outer(seen, seen), 1))
    found = [
        (visible[i].suspect.name, visible[j].suspect.name, float(overlap[i, j]))
        for i, j in zip(rows, columns, strict=True)
    ]
    return sorted(found, key=lambda pair: -pair[2])


def _next(campaign: Campaign, visible, products: Products, made: int, menu: tuple[BenchRun, ...]) -> NextRun:
    """The run of the menu after which fewest pairs are alike, and the alike ones least; then what is seen best."""
    before = products.of[:made].sum(axis=0)
    seen = np.array([v.seen for v in visible])
    alike = np.triu(np.outer(seen, seen) & (cosines(products.left_of(before)) > ALIKE), 1)
    best, worth = None, (math.inf, math.inf)
    for k, run in enumerate(menu):
        left = products.left_of(before + products.of[made + k])
        length, overlap = np.sqrt(np.diag(left)), cosines(left)
        still = overlap[alike]
        unseen = ~seen & (length > 0.0)
        cost = (
            float((still > ALIKE).sum() + still.sum()),
            -float((length[unseen] > SEEN).sum()) - float(np.log(np.maximum(length, 1e-9)).mean()),
        )
        if cost < worth:
            gained = tuple(v.suspect.name for v, new in zip(visible, unseen & (length > SEEN), strict=True) if new)
            rest = tuple(_pairs(visible, np.where(alike, overlap, 0.0), seen))
            best, worth = NextRun(run, texts(campaign, run.conditions), rest, gained), cost
    return best


def as_json(found: Plan) -> dict[str, Any]:
    """The plan as plain data; sizes in SI."""
    visible = [
        {
            "effect": v.suspect.id, "signal": v.suspect.signal, "slot": v.suspect.where, "parameter": v.parameter,
            "seen": v.seen, "size": v.size if math.isfinite(v.size) else None,
            "absent": v.absent if math.isfinite(v.absent) else None,
            "unit": v.unit if v.unknown else "", "share_of_strongest": v.share if math.isfinite(v.share) else None,
        }
        for v in found.visible
    ]  # fmt: skip
    best = found.next
    return {
        "version": VERSION,
        "campaign": found.campaign.name,
        "visible": visible,
        "not_told_apart": [list(pair) for pair in found.pairs()],
        "next_run": None if best is None else {
            "conditions": best.conditions, "chosen_from": found.tried, "becomes_visible": list(best.seen),
            "not_told_apart": [list(pair) for pair in best.alike],
        },
        "sentence": found.sentence(),
    }  # fmt: skip
