"""Fitting a machine to a campaign, with uncertainties."""
