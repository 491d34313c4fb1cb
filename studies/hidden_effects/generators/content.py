"""What the cases of a split are made of."""

import dataclasses

from edhas_jax.machine.effects import LIBRARY, Effect
from studies.hidden_effects.generators import judging, tuning, varied
from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import Link
from studies.hidden_effects.generators.disturbances import Disturbance
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.judging import first_machine as judging_first
from studies.hidden_effects.generators.judging import second_machine as judging_second
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.settings import RunDrift, WrongSheet
from studies.hidden_effects.generators.tuning import first_machine as tuning_first
from studies.hidden_effects.generators.tuning import second_machine as tuning_second


@dataclasses.dataclass(frozen=True)
class Content:
    """What a split has.

    Args:
        laws: other laws of the library's mechanisms.
        unlisted: laws of mechanisms that the library does not have.
        disturbances: small disturbances, which are not in the library.
        links: links of sensor chains.
        drifts: what is off from run to run.
        sheets: how a sheet of parameters is wrong.
        benches: test benches with their test plans.
        library: the effects that an engineer may name.
    """

    laws: tuple[Law, ...]
    unlisted: tuple[Law, ...]
    disturbances: tuple[Disturbance, ...]
    links: tuple[Link, ...]
    drifts: tuple[RunDrift, ...]
    sheets: tuple[WrongSheet, ...]
    benches: tuple[Bench, ...]
    library: tuple[type[Effect], ...] = LIBRARY


CONTENT = {
    Split.TUNING: Content(
        tuning.LAWS, tuning.UNLISTED, tuning.DISTURBANCES, tuning.LINKS, tuning.DRIFTS, tuning.SHEETS, tuning.BENCHES
    ),
    Split.VARIED: Content(
        varied.LAWS, tuning.UNLISTED, varied.DISTURBANCES, varied.LINKS, varied.DRIFTS, varied.SHEETS, varied.BENCHES
    ),
    Split.JUDGING: Content(
        judging.LAWS, judging.UNLISTED, judging.DISTURBANCES, judging.LINKS, judging.DRIFTS, judging.SHEETS,
        judging.BENCHES,
    ),
}  # fmt: skip
# of cases on machines of one's own, each with a list of effects of its own
OWN_MACHINES = {
    split: tuple(
        dataclasses.replace(
            CONTENT[split], laws=rig.LAWS, unlisted=rig.UNLISTED, disturbances=rig.DISTURBANCES, drifts=rig.DRIFTS,
            benches=(rig.BENCH,), library=rig.LIBRARY,
        )
        for rig in rigs
    )
    for split, rigs in (
        (Split.TUNING, (tuning_first, tuning_second)), (Split.JUDGING, (judging_first, judging_second)),
    )
}  # fmt: skip
