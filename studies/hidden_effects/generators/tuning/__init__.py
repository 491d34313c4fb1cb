"""What the tuning cases are made of: laws, small disturbances, sensor chains and benches."""

from studies.hidden_effects.generators.tuning.benches import BENCHES
from studies.hidden_effects.generators.tuning.chains import LINKS
from studies.hidden_effects.generators.tuning.disturbances import DISTURBANCES
from studies.hidden_effects.generators.tuning.laws import LAWS, UNLISTED
from studies.hidden_effects.generators.tuning.settings import DRIFTS, SHEETS

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS", "UNLISTED"]
