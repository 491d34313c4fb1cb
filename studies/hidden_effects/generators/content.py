"""What the cases of a split are made of."""

import dataclasses

from studies.hidden_effects.generators.benches import Bench
from studies.hidden_effects.generators.chains import Link
from studies.hidden_effects.generators.disturbances import Disturbance
from studies.hidden_effects.generators.earlier import benches as earlier_benches
from studies.hidden_effects.generators.earlier import chains as earlier_chains
from studies.hidden_effects.generators.earlier import coupling_laws as earlier_coupling
from studies.hidden_effects.generators.earlier import cylinder_laws as earlier_cylinder
from studies.hidden_effects.generators.earlier import disturbances as earlier_disturbances
from studies.hidden_effects.generators.earlier import electrical_laws as earlier_electrical
from studies.hidden_effects.generators.earlier import friction_laws as earlier_friction
from studies.hidden_effects.generators.earlier import hydraulic_laws as earlier_hydraulic
from studies.hidden_effects.generators.earlier import mover_laws as earlier_mover
from studies.hidden_effects.generators.earlier import settings as earlier_settings
from studies.hidden_effects.generators.earlier import unlisted_laws as earlier_unlisted
from studies.hidden_effects.generators.earlier import valve_laws as earlier_valves
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.generators.judging import benches as judging_benches
from studies.hidden_effects.generators.judging import chains as judging_chains
from studies.hidden_effects.generators.judging import coupling_laws as judging_coupling
from studies.hidden_effects.generators.judging import cylinder_laws as judging_cylinder
from studies.hidden_effects.generators.judging import disturbances as judging_disturbances
from studies.hidden_effects.generators.judging import electrical_laws as judging_electrical
from studies.hidden_effects.generators.judging import friction_laws as judging_friction
from studies.hidden_effects.generators.judging import hydraulic_laws as judging_hydraulic
from studies.hidden_effects.generators.judging import mover_laws as judging_mover
from studies.hidden_effects.generators.judging import settings as judging_settings
from studies.hidden_effects.generators.judging import suction_line_laws as judging_suction
from studies.hidden_effects.generators.judging import unlisted_laws as judging_unlisted
from studies.hidden_effects.generators.judging import valve_laws as judging_valves
from studies.hidden_effects.generators.judging import viscosity_laws as judging_viscosity
from studies.hidden_effects.generators.laws import Law
from studies.hidden_effects.generators.practice import electrical_laws as practice_electrical
from studies.hidden_effects.generators.practice import hydraulic_laws as practice_hydraulic
from studies.hidden_effects.generators.practice import mechanical_laws as practice_mechanical
from studies.hidden_effects.generators.settings import RunDrift, WrongSheet
from studies.hidden_effects.generators.tuning import benches as tuning_benches
from studies.hidden_effects.generators.tuning import chains as tuning_chains
from studies.hidden_effects.generators.tuning import coupling_laws as tuning_coupling
from studies.hidden_effects.generators.tuning import cylinder_laws as tuning_cylinder
from studies.hidden_effects.generators.tuning import disturbances as tuning_disturbances
from studies.hidden_effects.generators.tuning import electrical_laws as tuning_electrical
from studies.hidden_effects.generators.tuning import hydraulic_laws as tuning_hydraulic
from studies.hidden_effects.generators.tuning import mover_laws as tuning_mover
from studies.hidden_effects.generators.tuning import settings as tuning_settings
from studies.hidden_effects.generators.tuning import unlisted_laws as tuning_unlisted
from studies.hidden_effects.generators.varied import benches as varied_benches
from studies.hidden_effects.generators.varied import chains as varied_chains
from studies.hidden_effects.generators.varied import disturbances as varied_disturbances
from studies.hidden_effects.generators.varied import laws as varied_laws
from studies.hidden_effects.generators.varied import settings as varied_settings


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
    """

    laws: tuple[Law, ...]
    unlisted: tuple[Law, ...]
    disturbances: tuple[Disturbance, ...]
    links: tuple[Link, ...]
    drifts: tuple[RunDrift, ...]
    sheets: tuple[WrongSheet, ...]
    benches: tuple[Bench, ...]


_TUNING = Content(
    (*tuning_mover.LAWS, *tuning_coupling.LAWS, *tuning_electrical.LAWS, *tuning_hydraulic.LAWS, *tuning_cylinder.LAWS),
    tuning_unlisted.LAWS, tuning_disturbances.DISTURBANCES, tuning_chains.LINKS, tuning_settings.DRIFTS,
    tuning_settings.SHEETS, tuning_benches.BENCHES,
)  # fmt: skip
CONTENT = {
    Split.TUNING: _TUNING,
    Split.PRACTICE: dataclasses.replace(
        _TUNING, laws=(*practice_mechanical.LAWS, *practice_electrical.LAWS, *practice_hydraulic.LAWS)
    ),
    Split.VARIED: Content(
        varied_laws.LAWS, tuning_unlisted.LAWS, varied_disturbances.DISTURBANCES, varied_chains.LINKS,
        varied_settings.DRIFTS, varied_settings.SHEETS, varied_benches.BENCHES,
    ),
    Split.EARLIER: Content(
        (*earlier_mover.LAWS, *earlier_friction.LAWS, *earlier_coupling.LAWS, *earlier_electrical.LAWS,
         *earlier_hydraulic.LAWS, *earlier_valves.LAWS, *earlier_cylinder.LAWS),
        earlier_unlisted.LAWS, earlier_disturbances.DISTURBANCES, earlier_chains.LINKS, earlier_settings.DRIFTS,
        earlier_settings.SHEETS, earlier_benches.BENCHES,
    ),
    Split.JUDGING: Content(
        (*judging_mover.LAWS, *judging_friction.LAWS, *judging_coupling.LAWS, *judging_electrical.LAWS,
         *judging_hydraulic.LAWS, *judging_viscosity.LAWS, *judging_valves.LAWS, *judging_suction.LAWS,
         *judging_cylinder.LAWS),
        judging_unlisted.LAWS, judging_disturbances.DISTURBANCES, judging_chains.LINKS, judging_settings.DRIFTS,
        judging_settings.SHEETS, judging_benches.BENCHES,
    ),
}  # fmt: skip
