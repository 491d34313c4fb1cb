"""Elasticities, Sobol indices and Morris screening."""
