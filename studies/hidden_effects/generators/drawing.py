"""Draw a case by family, split and number."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from edhas_jax.core.runtime import single_threaded_algebra
from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.candidates import SINGLE_EFFECT_SLOTS, can_mount
from edhas_jax.machine.effects import LIBRARY, Effect, OilTemperature
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.campaign import Use, has_parameter
from edhas_jax.measurements.synthetic_campaign import planned_campaign
from edhas_jax.simulation.rk4_reference import Unstable
from studies.hidden_effects import cases
from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import draw_links, late_signals, typical_noise
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.disturbances import draw_disturbances
from studies.hidden_effects.generators.hidden_case import Family, Hidden, HiddenCase, Split
from studies.hidden_effects.generators.laws import Law, library_law
from studies.hidden_effects.generators.records import recorded
from studies.hidden_effects.generators.settings import draw_drifts, usual_deviations, with_deviations
from studies.hidden_effects.generators.similarity import MAX_SHARE, shares_of_generic_terms, shares_of_similar_effects
from studies.hidden_effects.generators.sizes import MIN_VISIBLE, Drawn, draw_visible
from studies.hidden_effects.generators.visibility import VisibilityTest, whitening_filter

MAX_ATTEMPTS = 60  # draws of a whole case
# numbers of family (a) at which another split begins; below them are tuning cases
FIRST_LIBRARY_CASES = {Split.EARLIER: cases.FIRST_EARLIER_CASE, Split.JUDGING: cases.FIRST_TEST_CASE}
SHARE_OF_NULLS = 0.4  # of the families with and without an effect
SHARE_OF_TRIPLES = 1.0 / 3.0  # of the cases with several effects
SHARE_OF_OTHER_LAWS = 0.5  # of the effects of a case with several, or of a small campaign
SHARE_OF_UNLISTED = 0.5  # of the withheld effects
SHARE_OF_WRONG_SHEETS = 0.6  # of the cases whose settings are off
SHORTEST = 0.55  # of the duration of a run, in a small campaign
# part of the seed: the earlier judging split has kept its number, so that its cases are the same
_SPLIT_NUMBER = {Split.TUNING: 1, Split.EARLIER: 2, Split.PRACTICE: 3, Split.VARIED: 4, Split.JUDGING: 5}
_FAMILY_NUMBER = {family: k for k, family in enumerate(Family)}
_DIFFICULTIES = (Family.DISTURBANCES, Family.SENSOR_CHAINS, Family.SETTINGS)  # of cases with several effects, in turn


@single_threaded_algebra
def draw_case(family: Family, split: Split, number: int) -> HiddenCase:
    """Draw a case; the same arguments give the same case.

    Args:
        family: what makes it difficult.
        split: of what it is made.
        number: 0 or more.

    Raises:
        RuntimeError: nothing visible was found in many draws.
    """
    if family is Family.LIBRARY_LAWS:
        return _library_case(split, number)
    for attempt in range(MAX_ATTEMPTS):
        rng = np.random.default_rng([20251101, _SPLIT_NUMBER[split], _FAMILY_NUMBER[family], number, attempt])
        case = _Draw(family, split, number, attempt, rng).case()
        if case is not None:
            return case
    raise RuntimeError(f"{family.value}, {split.value} case {number}: nothing visible in {MAX_ATTEMPTS} draws")


def _library_case(split: Split, number: int) -> HiddenCase:
    """A case of `studies.hidden_effects.cases`, whose numbers tell what they may be used for."""
    drawn = cases.draw_case(FIRST_LIBRARY_CASES.get(split, 0) + number)
    hidden = tuple(
        Hidden(
            h.candidate.name,
            (h.candidate.location,) if h.candidate.signal else library_law(h.candidate.kind).locations,
            h.candidate.id, h.values, h.visible,
        )
        for h in drawn.hidden
    )  # fmt: skip
    noise = {n: channel.noise for n, channel in drawn.campaign.channels.items()}
    return HiddenCase(
        Family.LIBRARY_LAWS, split, number, drawn.campaign, hidden, tuple(drawn.withheld), "library", true_noise=noise
    )


class _Draw:
    """One attempt at a case."""

    def __init__(self, family: Family, split: Split, number: int, attempt: int, rng: np.random.Generator):
        self.family, self.split, self.number, self.attempt, self.rng = family, split, number, attempt, rng
        self.content = CONTENT[split]
        self.difficulty = family
        if family is Family.SEVERAL:
            self.difficulty = _DIFFICULTIES[number % len(_DIFFICULTIES)]

    def case(self) -> HiddenCase | None:
        """The case; None where something hidden cannot be seen, or where the machine cannot be simulated."""
        rng = self.rng
        laws, bench = self._laws_and_bench()
        if self.family is Family.SMALL_CAMPAIGNS:
            bench = _smaller(bench, rng)
        machine = bench.machine(*(law.mechanism for law in laws))
        name = f"{self.family.name.lower()}_{self.split.value}_{self.number:04d}"
        plan = planned_campaign(name, machine, bench.uncertain, bench.channels, bench.runs, bench.interval)
        # of an effect that the engineer's model lacks he knows nothing
        plan = dataclasses.replace(plan, uncertain=plan.uncertain_in(machine))
        sheet, drifts, factors = "", (), {}
        deviations = usual_deviations(rng, len(plan.uncertain_in(machine)))
        if self.difficulty is Family.SETTINGS:
            drifts, factors = draw_drifts(self.content.drifts, bench.settings, len(bench.runs), rng)
            if not all(has_parameter(machine, name) for name in factors):
                return None  # a drift of the oil on a bench without oil
            if rng.uniform() < SHARE_OF_WRONG_SHEETS:
                wrong = self.content.sheets[rng.integers(len(self.content.sheets))]
                sheet, deviations = wrong.id, wrong.deviations(rng, len(deviations))
        truth = with_deviations(plan, machine, deviations)
        chain = ()
        if self.difficulty is Family.SENSOR_CHAINS:
            chain = draw_links(self.content.links, list(plan.channels), rng)
        noise = typical_noise(chain)
        test = VisibilityTest(plan, truth, bench.settings, None if noise is None else whitening_filter(noise))
        is_disturbed = self.difficulty is Family.DISTURBANCES
        disturbances = draw_disturbances(test, self.content.disturbances, rng) if is_disturbed else None
        if is_disturbed and disturbances is None:
            return None
        drawn = self._drawn(test, laws, max(MIN_VISIBLE, disturbances.visible if disturbances else 0.0))
        if drawn is None:
            return None
        truth = _with_all(truth if disturbances is None else disturbances.machine, drawn)
        try:
            campaign = recorded(plan, truth, rng, chain, factors)
        except Unstable:
            return None
        hidden = tuple(
            Hidden(d.law.mechanism.id if d.law.mechanism else "", d.law.locations, d.law.id, d.values, d.visible)
            for d in drawn
        )
        withheld = [law.mechanism for law in laws if law.mechanism] if self.family is Family.WITHHELD else []
        return HiddenCase(
            self.family, self.split, self.number, campaign, hidden, tuple(withheld), bench.id,
            disturbances.sizes if disturbances else {}, disturbances.visible if disturbances else 0.0,
            tuple(link.id for link in chain), (*drifts, sheet) if sheet else drifts, late_signals(chain),
            {n: channel.noise for n, channel in plan.channels.items()}, truth,
        )  # fmt: skip

    def _drawn(self, test: VisibilityTest, laws: Sequence[Law], least: float) -> list[Drawn] | None:
        """The laws with their parameters; None where one of them cannot be seen, or where it is not unknown."""
        drawn = []
        for law in laws:
            found = draw_visible(test, law, self.rng, least)
            if found is None:
                return None
            drawn.append(found)
        if len(drawn) > 1:
            overlaps = np.array([[test.all.overlap(a.change, b.change) for b in drawn] for a in drawn])
            beside = 1.0 / np.diag(np.linalg.inv(overlaps))  # visible beside any multiple of the others
            drawn = [dataclasses.replace(d, visible=float(v)) for d, v in zip(drawn, beside, strict=True)]
            if beside.min() < least:
                return None
        if self.family is Family.WITHHELD:
            for d in drawn:
                shares = shares_of_similar_effects(test, d.law, d.change)
                if max(shares.values(), default=0.0) > MAX_SHARE:
                    return None
                if max(shares_of_generic_terms(test, d.law, d.change).values()) > MAX_SHARE:
                    return None
        return drawn

    def _laws_and_bench(self) -> tuple[list[Law], Bench]:
        """The laws to hide, and a bench that can have them."""
        if self.family is Family.OTHER_LAWS:
            laws = self.content.laws
            law = self._any(laws) if self.attempt % 4 == 3 else laws[self._turn(len(laws))]
            return [law], self._bench([law])
        bench = self._bench([])
        # checking whether a bench can have a law traces its equations, so only the laws to choose from are checked
        if self.family is Family.WITHHELD:
            if self.rng.uniform() < SHARE_OF_UNLISTED:
                return [self._any(_possible(bench, self.content.unlisted))], bench
            addable = [kind for kind in LIBRARY if kind not in bench.refined]
            return [self._any(_possible(bench, map(library_law, addable)))], bench
        if self.family is Family.SEVERAL:
            of_library, others = _possible(bench, map(library_law, LIBRARY)), _possible(bench, self.content.laws)
            wanted = 3 if self.rng.uniform() < SHARE_OF_TRIPLES else 2
            while True:
                laws = [
                    self._any(others if self.rng.uniform() < SHARE_OF_OTHER_LAWS else of_library) for _ in range(wanted)
                ]
                if _may_act_together(laws):
                    return laws, bench
        if self.rng.uniform() < SHARE_OF_NULLS:
            return [], bench
        other = self.family is Family.SMALL_CAMPAIGNS and self.rng.uniform() < SHARE_OF_OTHER_LAWS
        return [self._any(_possible(bench, self.content.laws if other else map(library_law, LIBRARY)))], bench

    def _bench(self, laws: Sequence[Law]) -> Bench:
        usable = [bench for bench in self.content.benches if all(_can_have(bench, law) for law in laws)]
        weights = np.array([bench.weight for bench in usable])
        return usable[self.rng.choice(len(usable), p=weights / weights.sum())]

    def _turn(self, count: int) -> int:
        """Every law in turn, neighbours far apart."""
        stride = next(s for s in range(7, 7 + count) if np.gcd(s, count) == 1)
        return stride * self.number % count

    def _any(self, laws: Sequence[Law]) -> Law:
        return laws[self.rng.integers(len(laws))]


def _possible(bench: Bench, laws: Iterable[Law]) -> list[Law]:
    """Those of some laws that a bench can have."""
    return [law for law in laws if _can_have(bench, law)]


def _can_have(bench: Bench, law: Law) -> bool:
    """Whether a law can act at a bench such that its mechanism can be named there."""
    if law.mechanism is OilTemperature and "oil_temperature" not in bench.conditions:
        return False
    kinds: list[type[Effect]] = [law.kind] if law.mechanism is None else [law.kind, law.mechanism]
    if any(not set(kind.slots) <= set(bench.rig.slots) for kind in kinds):
        return False  # as `can_mount` would find, after tracing the equations
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
    exclusive = [slot.name for law in laws for slot in law.kind.slots if slot.name in SINGLE_EFFECT_SLOTS]
    return len(set(mechanisms)) == len(mechanisms) and len(set(exclusive)) == len(exclusive)


def _with_all(machine: Rig, drawn: Sequence[Drawn]) -> Rig:
    return replace(machine, effects=(*machine.effects, *(d.law.kind(**d.values) for d in drawn)))
