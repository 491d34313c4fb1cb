"""Campaigns of measurements: files, checks, sensors, predicted signals and comparison."""
