"""What the judging cases are made of; no law, disturbance, link, drift, sheet, run or machine is in another split."""

from studies.hidden_effects.generators.judging.benches import BENCHES
from studies.hidden_effects.generators.judging.chains import LINKS
from studies.hidden_effects.generators.judging.disturbances import DISTURBANCES
from studies.hidden_effects.generators.judging.laws import LAWS
from studies.hidden_effects.generators.judging.settings import DRIFTS, SHEETS
from studies.hidden_effects.generators.judging.unlisted import UNLISTED

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS", "UNLISTED"]
