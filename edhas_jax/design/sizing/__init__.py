"""Sizing: gradient-based optimisation of dimensions under bounds and constraints."""
