"""Checks of the data of a campaign: what looks wrong, what is impossible, how large the noise is."""
