"""Gradient-based sizing under bounds and limits."""
