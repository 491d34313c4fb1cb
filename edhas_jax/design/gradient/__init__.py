"""Derivatives of metrics by parameters in the periodic state."""
