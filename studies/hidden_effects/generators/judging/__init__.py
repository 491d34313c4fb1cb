"""What the judging cases are made of.

None of these laws, disturbances, links of sensor chains, drifts, parameter sheets, runs and machines is used in another
split.
"""

from studies.hidden_effects.generators.judging.benches import BENCHES
from studies.hidden_effects.generators.judging.chains import LINKS
from studies.hidden_effects.generators.judging.disturbances import DISTURBANCES
from studies.hidden_effects.generators.judging.laws import LAWS
from studies.hidden_effects.generators.judging.settings import DRIFTS, SHEETS
from studies.hidden_effects.generators.judging.unlisted import UNLISTED

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS", "UNLISTED"]
