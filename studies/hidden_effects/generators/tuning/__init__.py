"""What the tuning cases are made of.

None of these laws, disturbances, links of sensor chains, drifts, parameter sheets, runs and machines is used in the
judging split.
"""

from studies.hidden_effects.generators.tuning.benches import BENCHES
from studies.hidden_effects.generators.tuning.chains import LINKS
from studies.hidden_effects.generators.tuning.disturbances import DISTURBANCES
from studies.hidden_effects.generators.tuning.laws import LAWS
from studies.hidden_effects.generators.tuning.settings import DRIFTS, SHEETS
from studies.hidden_effects.generators.tuning.unlisted import UNLISTED

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS", "UNLISTED"]
