"""Exploring and sizing: batches of designs, derivatives, sweeps, sensitivities, optimisation."""
