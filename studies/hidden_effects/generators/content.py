"""What the cases of a split are made of."""

import dataclasses

from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import Link
from studies.hidden_effects.generators.crumbs import Crumb
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.judging import benches as judging_benches
from studies.hidden_effects.generators.judging import chains as judging_chains
from studies.hidden_effects.generators.judging import crumbs as judging_crumbs
from studies.hidden_effects.generators.judging import electrical_laws as judging_electrical
from studies.hidden_effects.generators.judging import mover_laws as judging_mover
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.tuning import benches as tuning_benches
from studies.hidden_effects.generators.tuning import chains as tuning_chains
from studies.hidden_effects.generators.tuning import crumbs as tuning_crumbs
from studies.hidden_effects.generators.tuning import electrical_laws as tuning_electrical
from studies.hidden_effects.generators.tuning import mover_laws as tuning_mover


@dataclasses.dataclass(frozen=True)
class Content:
    """Laws, small disturbances, links of sensor chains and benches of a split."""

    laws: tuple[Law, ...]
    crumbs: tuple[Crumb, ...]
    links: tuple[Link, ...]
    benches: tuple[Bench, ...]


CONTENT = {
    Split.TUNING: Content(
        tuning_mover.LAWS + tuning_electrical.LAWS, tuning_crumbs.CRUMBS, tuning_chains.LINKS, tuning_benches.BENCHES
    ),
    Split.JUDGING: Content(
        judging_mover.LAWS + judging_electrical.LAWS, judging_crumbs.CRUMBS, judging_chains.LINKS,
        judging_benches.BENCHES,
    ),
}  # fmt: skip
