"""Draw a case by family, split and number."""

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.core.structs import replace
from edhas_jax.machine.effects import OilTemperature
from edhas_jax.machine.parameters import has_parameter
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Use
from studies.hidden_effects import answers
from studies.hidden_effects.answers import HiddenEffect, Truth
from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import DrawnLink, draw_links, typical_noise
from studies.hidden_effects.generators.content import CONTENT, OWN_MACHINES
from studies.hidden_effects.generators.disturbances import draw_disturbances
from studies.hidden_effects.generators.hidden_case import (
    ORDER,
    WITH_ANY_DIFFICULTY,
    CaseKey,
    Family,
    HiddenCase,
    Split,
)
from studies.hidden_effects.generators.laws import Law, can_mount, library_law
from studies.hidden_effects.generators.records import recorded
from studies.hidden_effects.generators.sensor_faults import draw_fault
from studies.hidden_effects.generators.settings import draw_drifts, usual_deviations, with_deviations
from studies.hidden_effects.generators.similarity import MAX_SHARE, shares_of_similar_effects
from studies.hidden_effects.generators.sizes import MIN_VISIBLE, Drawn, draw_visible
from studies.hidden_effects.generators.visibility import VisibilityTest, whitening_filter
from studies.rk4_reference import Unstable
from studies.synthetic_campaign import planned_campaign

MAX_ATTEMPTS = 60  # draws of a whole case
SHARE_OF_NULLS = 0.4  # of the families with and without an effect
SHARE_OF_TRIPLES = 1.0 / 3.0  # of the cases with several effects
SHARE_OF_OTHER_LAWS = 0.5  # of the effects of a case with several or one, or of a small campaign
SHARE_OF_UNLISTED = 0.5  # of the withheld effects
SHARE_OF_WRONG_SHEETS = 0.6  # of the cases whose settings are off
SHARE_AT_ONE_PLACE = 1.0 / 3.0  # of the pairs, which act on one component
FAULT_EVERY = 8  # single effects, of which one is a fault of a sensor
SHORTEST = 0.55  # of the duration of a run, in a small campaign
OWN_MACHINE_EVERY = 12  # cases that go by number, of which one is on a machine of one's own
LARGEST_VISIBLE = 1e5  # of single effects, drawn evenly in its logarithm from MIN_VISIBLE on
VISIBLE_BESIDE_DISTURBANCES = 3000.0  # from which these are drawn at all; with less, hardly any would be small enough
GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)  # its multiples, less whole numbers, fill 0 … 1 evenly
_SPLIT_NUMBER = {Split.VARIED: 4, Split.TUNING: 6, Split.JUDGING: 7}  # part of the seed


class Difficulty(enum.Enum):
    """What is wrong in a campaign beside what is hidden."""

    DISTURBANCES = enum.auto()
    CHAIN = enum.auto()
    SETTINGS = enum.auto()
    SMALL = enum.auto()


_OF_FAMILY = {
    Family.DISTURBANCES: Difficulty.DISTURBANCES, Family.SENSOR_CHAINS: Difficulty.CHAIN,
    Family.SETTINGS: Difficulty.SETTINGS, Family.SMALL_CAMPAIGNS: Difficulty.SMALL,
}  # fmt: skip
_IN_TURN = (Difficulty.DISTURBANCES, Difficulty.CHAIN, Difficulty.SETTINGS)  # of cases with several effects
# share of the cases of `WITH_ANY_DIFFICULTY` that have each difficulty, in the order of `Difficulty`
_SHARES = {Family.NULLS: (0.75, 0.85, 0.75, 0.15), Family.UNKNOWNS: (0.2, 0.35, 0.35, 0.05)}
_USUAL_SHARES = (0.3, 0.35, 0.35, 0.05)


@single_threaded_algebra
def draw(key: CaseKey, first: int = 0) -> HiddenCase:
    """Draw a case; the same key gives the same case.

    Args:
        key: what determines the case.
        first: the attempt to begin with: that of a case that has been drawn before, which saves the others.

    Raises:
        RuntimeError: nothing visible was found in many draws.
    """
    family = Family(key.family)
    for attempt in range(first, MAX_ATTEMPTS):
        seed = [20251101, _SPLIT_NUMBER[key.split], 1 + list(Family).index(family), key.number, attempt]
        case = _Draw(key, family, attempt, np.random.default_rng(seed)).case()
        if case is not None:
            return case
    raise RuntimeError(f"{key}, {key.split.value}: nothing visible in {MAX_ATTEMPTS} draws")


class _Draw:
    """One attempt at a case."""

    def __init__(self, key: CaseKey, family: Family, attempt: int, rng: np.random.Generator):
        self.key, self.family, self.attempt, self.rng = key, family, attempt, rng
        self.content, self.visible, self.is_fault = CONTENT[key.split], None, False
        self.wrong = {_OF_FAMILY.get(family)}
        if family is Family.SEVERAL:
            self.wrong = {_IN_TURN[key.number % len(_IN_TURN)]}
        if key.split.goes_by_number:
            turn, place = divmod(key.number, OWN_MACHINE_EVERY)
            if place == OWN_MACHINE_EVERY // 2:
                own = OWN_MACHINES[key.split]
                self.content = own[turn % len(own)]
        if family in WITH_ANY_DIFFICULTY:
            shares = _SHARES.get(family, _USUAL_SHARES)
            self.wrong = {d for d, share in zip(Difficulty, shares, strict=True) if rng.uniform() < share}
            if family is Family.SINGLES:
                singles = key.number
                if key.split.goes_by_number:
                    turn, place = divmod(key.number, len(ORDER))
                    singles = turn * ORDER.count(key.family) + ORDER[:place].count(key.family)
                self.is_fault, position = singles % FAULT_EVERY == FAULT_EVERY - 1, GOLDEN * singles % 1.0
                self.visible = MIN_VISIBLE * (LARGEST_VISIBLE / MIN_VISIBLE) ** position
                if self.visible < VISIBLE_BESIDE_DISTURBANCES:
                    self.wrong -= {Difficulty.DISTURBANCES}

    def case(self) -> HiddenCase | None:
        """The case; None where something hidden cannot be seen, or where the machine cannot be simulated."""
        rng, wrong, key = self.rng, self.wrong, self.key
        laws, bench = self._laws_and_bench()
        if Difficulty.SMALL in wrong:
            bench = _smaller(bench, rng)
        machine = bench.machine(*(law.mechanism for law in laws))
        name = f"{self.family.name.lower()}_{key.split.value}_{key.number:04d}"
        plan = planned_campaign(name, machine, bench.uncertain, bench.channels, bench.runs, bench.interval)
        # of an effect that the engineer's model lacks he knows nothing
        plan = dataclasses.replace(plan, uncertain=plan.uncertain_in(machine))
        sheet, drifts, factors = "", (), {}
        deviations = usual_deviations(rng, len(plan.uncertain_in(machine)))
        if Difficulty.SETTINGS in wrong:
            # not of the oil on a bench without oil
            known = [d for d in self.content.drifts if d.parameter is None or has_parameter(machine, d.parameter)]
            drifts, factors = draw_drifts(known, bench.settings, len(bench.runs), rng)
            if rng.uniform() < SHARE_OF_WRONG_SHEETS:
                sheet_kind = self.content.sheets[rng.integers(len(self.content.sheets))]
                sheet, deviations = sheet_kind.id, sheet_kind.deviations(rng, len(deviations))
        truth = with_deviations(plan, machine, deviations)
        chain = draw_links(self.content.links, list(plan.channels), rng) if Difficulty.CHAIN in wrong else ()
        noise = typical_noise(chain)
        test = VisibilityTest(plan, truth, bench.settings, None if noise is None else whitening_filter(noise))
        disturbances = None
        if Difficulty.DISTURBANCES in wrong:
            disturbances = draw_disturbances(test, self.content.disturbances, rng)
            if disturbances is None:
                return None
        least = max(MIN_VISIBLE, disturbances.visible if disturbances else 0.0)
        fault: DrawnLink | None = None
        if self.is_fault:
            found = draw_fault(test, rng, self.visible, least)
            if found is None:
                return None
            fault, hidden = found
            drawn = []
        else:
            drawn = self._drawn(test, laws, least)
            if drawn is None:
                return None
            hidden = tuple(map(_hidden, drawn))
        truth = _with_all(truth if disturbances is None else disturbances.machine, drawn)
        try:
            campaign = recorded(plan, truth, rng, chain if fault is None else (*chain, fault), factors, bench.step)
        except Unstable:
            return None
        is_withheld = self.family in (Family.WITHHELD, Family.UNKNOWNS)
        withheld = {law.name for law in laws} if is_withheld else set()
        ids, settings = tuple(link.id for link in chain), (*drifts, sheet) if sheet else drifts
        about = Truth(
            key.family, key.split.value, key.number, hidden, bool(hidden) and is_withheld,
            tuple(campaign.channels) if chain else (), _description(bench, hidden, disturbances, ids, settings),
            self.attempt,
        )  # fmt: skip
        return HiddenCase(
            about, campaign, tuple(kind for kind in self.content.library if kind.id not in withheld), truth,
            disturbances.sizes if disturbances else {}, ids, settings,
        )  # fmt: skip

    def _drawn(self, test: VisibilityTest, laws: Sequence[Law], least: float) -> list[Drawn] | None:
        """The laws with their parameters; None where one of them cannot be seen, or where it is not unknown."""
        drawn = []
        for law in laws:
            found = draw_visible(test, law, self.rng, least, self.visible)
            if found is None:
                return None
            drawn.append(found)
        if len(drawn) > 1:
            overlaps = np.array([[test.all.overlap(a.change, b.change) for b in drawn] for a in drawn])
            beside = 1.0 / np.diag(np.linalg.inv(overlaps))  # visible beside any multiple of the others
            drawn = [dataclasses.replace(d, visible=float(v)) for d, v in zip(drawn, beside, strict=True)]
            if beside.min() < least:
                return None
        if self.family in (Family.WITHHELD, Family.UNKNOWNS):
            for d in drawn:
                shares = shares_of_similar_effects(test, d.law, d.change, self.content.library)
                if max(shares.values(), default=0.0) > MAX_SHARE:
                    return None
        return drawn

    def _laws_and_bench(self) -> tuple[list[Law], Bench]:
        """The laws to hide, and a bench that can have them."""
        content, rng = self.content, self.rng
        if self.family is Family.OTHER_LAWS:
            law = self._any(content.laws) if self.attempt % 4 == 3 else content.laws[self._turn(len(content.laws))]
            return [law], self._bench([law])
        bench, library = self._bench([]), [library_law(kind) for kind in content.library]
        if self.family in (Family.WITHHELD, Family.UNKNOWNS):
            if rng.uniform() < SHARE_OF_UNLISTED:
                return [self._one_of(bench, content.unlisted)], bench
            addable = [law for law in library if law.kind not in bench.refined]
            if self.family is Family.UNKNOWNS and rng.uniform() < SHARE_OF_OTHER_LAWS:
                addable = content.laws
            return [self._one_of(bench, addable)], bench
        if self.family in (Family.SEVERAL, Family.PAIRS):
            return self._several(bench, library), bench
        if self.family is Family.SINGLES:
            if self.is_fault:
                return [], bench
            return [self._one_of(bench, content.laws if rng.uniform() < SHARE_OF_OTHER_LAWS else library)], bench
        if self.family is Family.NULLS or rng.uniform() < SHARE_OF_NULLS:
            return [], bench
        other = self.family is Family.SMALL_CAMPAIGNS and rng.uniform() < SHARE_OF_OTHER_LAWS
        return [self._one_of(bench, content.laws if other else library)], bench

    def _several(self, bench: Bench, library: Sequence[Law]) -> list[Law]:
        """Two or three laws that may act together."""
        rng = self.rng
        wanted = 3 if rng.uniform() < SHARE_OF_TRIPLES else 2
        at_one = self.family is Family.PAIRS and rng.uniform() < SHARE_AT_ONE_PLACE
        while True:
            laws = [
                self._one_of(bench, self.content.laws if rng.uniform() < SHARE_OF_OTHER_LAWS else library)
                for _ in range(wanted)
            ]
            places = [set(law.locations) for law in laws]
            if _may_act_together(laws) and (not at_one or places[0] & places[1]):
                return laws

    def _one_of(self, bench: Bench, laws: Sequence[Law]) -> Law:
        """One of some laws that a bench can have; checking that traces its equations, so that few are checked."""
        if self.key.split.goes_by_number:
            while not _can_have(bench, law := self._any(laws)):
                pass
            return law
        return self._any([law for law in laws if _can_have(bench, law)])

    def _bench(self, laws: Sequence[Law]) -> Bench:
        usable = [bench for bench in self.content.benches if all(_can_have(bench, law) for law in laws)]
        weights = np.array([bench.weight for bench in usable])
        return usable[self.rng.choice(len(usable), p=weights / weights.sum())]

    def _turn(self, count: int) -> int:
        """Every law in turn, neighbours far apart."""
        stride = next(s for s in range(7, 7 + count) if np.gcd(s, count) == 1)
        return stride * self.key.number % count

    def _any(self, laws: Sequence[Law]) -> Law:
        return laws[self.rng.integers(len(laws))]


def _hidden(drawn: Drawn) -> HiddenEffect:
    """A law as what is hidden."""
    law = answers.Law.LIBRARY if drawn.law.kind is drawn.law.mechanism else answers.Law.DIFFERS
    return HiddenEffect(drawn.law.name, drawn.law.locations, law, drawn.values, drawn.visible)


def _description(bench: Bench, hidden, disturbances, chain: Sequence[str], settings: Sequence[str]) -> str:
    """The bench and what differs, in one line."""
    text = f"{bench.id}: {' + '.join(h.name for h in hidden) or 'nothing'}"
    sizes = disturbances.sizes if disturbances else ()
    for what, items in (("disturbances", sizes), ("chain", chain), ("settings", settings)):
        text += f"; {what}: {', '.join(items)}" if items else ""
    return text


def _can_have(bench: Bench, law: Law) -> bool:
    """Whether a law can act at a bench such that its mechanism can be named there."""
    if law.mechanism is OilTemperature and "oil_temperature" not in bench.conditions:
        return False
    kinds = [law.kind] if law.mechanism is None else [law.kind, law.mechanism]
    return all(can_mount(bench.machine(law.mechanism), kind) for kind in kinds)


def _smaller(bench: Bench, rng: np.random.Generator) -> Bench:
    """Two to four runs, of which one may be held out, shorter than planned; two or three of the sensors."""
    count = min(int(rng.integers(2, 5)), len(bench.runs))
    fitted = [run for run in bench.runs if run.use is Use.FIT]
    held_out = [run for run in bench.runs if run.use is Use.HOLDOUT] if count > 2 else []
    held_out = held_out[:1]
    chosen = sorted(rng.choice(len(fitted), min(count - len(held_out), len(fitted)), replace=False))
    share = float(rng.uniform(SHORTEST, 1.0))
    runs = [
        dataclasses.replace(run, duration=share * run.duration) for run in [*(fitted[k] for k in chosen), *held_out]
    ]
    names = list(bench.channels)
    kept = sorted(rng.choice(len(names), min(int(rng.integers(2, 4)), len(names)), replace=False))
    return dataclasses.replace(bench, runs=tuple(runs), channels={names[k]: bench.channels[names[k]] for k in kept})


def _may_act_together(laws: Sequence[Law]) -> bool:
    """Whether no mechanism comes twice, and no place that holds one effect only."""
    mechanisms = [law.mechanism for law in laws]
    exclusive = [slot.name for law in laws for slot in law.kind.slots if slot.is_exclusive]
    return len(set(mechanisms)) == len(mechanisms) and len(set(exclusive)) == len(exclusive)


def _with_all(machine: Rig, drawn: Sequence[Drawn]) -> Rig:
    return replace(machine, effects=(*machine.effects, *(d.law.kind(**d.values) for d in drawn)))
