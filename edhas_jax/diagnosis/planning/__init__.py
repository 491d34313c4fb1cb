"""Experiment planning: which effects planned runs would reveal, and which run to make next."""
