"""What the tuning cases are made of: laws, small disturbances, sensor chains and benches."""

from studies.hidden_effects.generators.tuning import benches, chains, disturbances, laws, settings

__all__ = ["benches", "chains", "disturbances", "laws", "settings"]
