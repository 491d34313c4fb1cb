"""Probabilities of sets of effects. Unfinished: `edhas diagnose` does not use it yet, but `diagnosis.search`."""
