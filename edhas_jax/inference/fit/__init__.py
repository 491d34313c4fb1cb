"""Fits: maximum a posteriori estimates of uncertain parameters from a campaign, with their uncertainty."""
