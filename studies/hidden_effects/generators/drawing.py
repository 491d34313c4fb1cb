"""Draw a case by family, split and number."""

import numpy as np

from edhas_jax.core.structs import replace
from edhas_jax.diagnosis.search.candidates import SINGLE_EFFECT_SLOTS
from edhas_jax.machine.effects import LIBRARY
from edhas_jax.machine.rigs import Rig
from edhas_jax.measurements.synthetic_campaign import draw_parameters, planned_campaign
from edhas_jax.simulation.rk4_reference import Unstable
from studies.hidden_effects import cases
from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import draw_links
from studies.hidden_effects.generators.content import CONTENT
from studies.hidden_effects.generators.crumbs import draw_crumbs
from studies.hidden_effects.generators.hidden_case import Family, Hidden, HiddenCase, Split
from studies.hidden_effects.generators.laws import Law, library_law
from studies.hidden_effects.generators.records import recorded
from studies.hidden_effects.generators.sizes import MIN_VISIBLE, Drawn, draw_visible
from studies.hidden_effects.generators.visibility import VisibilityTest

MAX_ATTEMPTS = 40  # draws of a whole case
SHARE_OF_NULLS = 0.4  # of the families with and without an effect
SHARE_OF_TRIPLES = 1.0 / 3.0  # of the cases with several effects
SHARE_OF_OTHER_LAWS = 0.5  # of the effects of a case with several, or of a small campaign
FAMILIES_WITH_NULLS = (Family.CRUMBS, Family.SENSOR_CHAINS, Family.SETTINGS, Family.SMALL_CAMPAIGNS)
_SPLIT_NUMBER = {Split.TUNING: 1, Split.JUDGING: 2}
_FAMILY_NUMBER = {family: k for k, family in enumerate(Family)}


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
    """A case of `studies.hidden_effects.cases`, whose test cases are those that judge."""
    drawn = cases.draw_case(number if split is Split.TUNING else cases.FIRST_TEST_CASE + number)
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

    def case(self) -> HiddenCase | None:
        """The case; None where something hidden cannot be seen, or where the machine cannot be simulated."""
        bench = self.content.benches[self.number % len(self.content.benches)]
        laws = self._laws(bench)
        refined = [kind for kind in bench.refined if kind not in [law.mechanism for law in laws]]
        machine = bench.rig(effects=tuple(kind() for kind in refined))
        name = f"{self.family.name.lower()}_{self.split.value}_{self.number:04d}"
        plan = planned_campaign(name, machine, bench.uncertain, bench.channels, bench.runs, bench.interval)
        truth = draw_parameters(plan, machine, self.rng)
        test = VisibilityTest(plan, truth)
        crumbs = draw_crumbs(test, self.content.crumbs, self.rng) if self.has_crumbs else None
        least = max(MIN_VISIBLE, crumbs.visible) if crumbs else MIN_VISIBLE
        drawn: list[Drawn] = []
        for law in laws:
            found = draw_visible(test, law, self.rng, least)
            if found is None:
                return None
            drawn.append(found)
        visible = self._separately_visible(test, drawn, least)
        if visible is None:
            return None
        truth = _with_all(truth if crumbs is None else crumbs.machine, drawn)
        chain = draw_links(self.content.links, list(plan.channels), self.rng) if self.has_chain else ()
        try:
            campaign = recorded(plan, truth, self.rng, chain)
        except Unstable:
            return None
        hidden = tuple(
            Hidden(d.law.mechanism.id if d.law.mechanism else "", d.law.locations, d.law.id, d.values, v)
            for d, v in zip(drawn, visible, strict=True)
        )
        withheld = [law.mechanism for law in laws] if self.family is Family.WITHHELD else []
        return HiddenCase(
            self.family, self.split, self.number, campaign, hidden, tuple(kind for kind in withheld if kind),
            bench.id, crumbs.sizes if crumbs else {}, crumbs.visible if crumbs else 0.0,
            tuple(link.id for link in chain), (), {n: c.noise for n, c in plan.channels.items()},
        )  # fmt: skip

    @property
    def has_crumbs(self) -> bool:
        """Whether the case has small unlisted physics."""
        return self.family is Family.CRUMBS or (self.family is Family.SEVERAL and self.number % 2 == 0)

    @property
    def has_chain(self) -> bool:
        """Whether recorder and sensors are not ideal."""
        return self.family is Family.SENSOR_CHAINS or (self.family is Family.SEVERAL and self.number % 2 == 1)

    def _laws(self, bench: Bench) -> list[Law]:
        """The laws to hide."""
        others = [law for law in self.content.laws if set(law.kind.slots) <= set(bench.rig.slots)]
        of_library = [library_law(kind) for kind in LIBRARY if set(kind.slots) <= set(bench.rig.slots)]
        if self.family is Family.OTHER_LAWS:
            return [others[(self.number + self.attempt) % len(others)] if self.attempt else others[self._turn(others)]]
        if self.family is Family.WITHHELD:
            return [self._any(of_library)]
        if self.family is Family.SEVERAL:
            wanted = 3 if self.rng.uniform() < SHARE_OF_TRIPLES else 2
            while True:
                kinds = [self._any(others if self.rng.uniform() < SHARE_OF_OTHER_LAWS else of_library)
                         for _ in range(wanted)]  # fmt: skip
                if _may_act_together(kinds):
                    return kinds
        if self.rng.uniform() < SHARE_OF_NULLS:
            return []
        return [self._any(of_library)]

    def _turn(self, laws: list[Law]) -> int:
        """Every law in turn, neighbours far apart."""
        stride = next(s for s in range(7, 7 + len(laws)) if np.gcd(s, len(laws)) == 1)
        return stride * self.number % len(laws)

    def _any(self, laws: list[Law]) -> Law:
        return laws[self.rng.integers(len(laws))]

    def _separately_visible(self, test: VisibilityTest, drawn: list[Drawn], least: float) -> list[float] | None:
        """What is visible of each beside the others; None where that is too little."""
        if len(drawn) < 2:
            return [d.visible for d in drawn]
        overlaps = np.array([[test.all.overlap(a.change, b.change) for b in drawn] for a in drawn])
        visible = [float(v) for v in 1.0 / np.diag(np.linalg.inv(overlaps))]
        return visible if min(visible) > least else None


def _may_act_together(laws: list[Law]) -> bool:
    """Whether no mechanism comes twice, and no place that holds one effect only."""
    mechanisms = [law.mechanism for law in laws]
    exclusive = [slot.name for law in laws for slot in law.kind.slots if slot.name in SINGLE_EFFECT_SLOTS]
    return len(set(mechanisms)) == len(mechanisms) and len(set(exclusive)) == len(exclusive)


def _with_all(machine: Rig, drawn: list[Drawn]) -> Rig:
    return replace(machine, effects=(*machine.effects, *(d.law.kind(**d.values) for d in drawn)))
