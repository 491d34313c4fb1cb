"""What the varied cases are made of: laws, disturbances, sensor chains and benches that are drawn at random.

A method that is developed on a few laws and benches may learn these instead of the mechanisms. Here every case has its
own law, and there are many benches. They are for development; nothing of them is among what judges.
"""

from studies.hidden_effects.generators.varied import benches, chains, disturbances, laws, settings

__all__ = ["benches", "chains", "disturbances", "laws", "settings"]
