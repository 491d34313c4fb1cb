"""Sensitivity of metrics to parameters: local elasticities, Sobol indices, Morris screening."""
