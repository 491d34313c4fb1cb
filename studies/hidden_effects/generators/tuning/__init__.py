"""What the tuning cases are made of; no law, disturbance, link, drift, sheet, run or machine is among what judges."""

from studies.hidden_effects.generators.tuning.benches import BENCHES
from studies.hidden_effects.generators.tuning.chains import LINKS
from studies.hidden_effects.generators.tuning.disturbances import DISTURBANCES
from studies.hidden_effects.generators.tuning.laws import LAWS
from studies.hidden_effects.generators.tuning.settings import DRIFTS, SHEETS
from studies.hidden_effects.generators.tuning.unlisted import UNLISTED

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS", "UNLISTED"]
