"""What the varied cases are made of: laws, disturbances, sensor chains and benches that are drawn at random.

A method that is developed on a few laws and benches may learn these instead of the mechanisms. Here every case has its
own law, and there are many benches. They are for development; nothing of them is among what judges.
"""

from studies.hidden_effects.generators.varied.benches import BENCHES
from studies.hidden_effects.generators.varied.chains import LINKS
from studies.hidden_effects.generators.varied.disturbances import DISTURBANCES
from studies.hidden_effects.generators.varied.laws import LAWS
from studies.hidden_effects.generators.varied.settings import DRIFTS, SHEETS

__all__ = ["BENCHES", "DISTURBANCES", "DRIFTS", "LAWS", "LINKS", "SHEETS"]
