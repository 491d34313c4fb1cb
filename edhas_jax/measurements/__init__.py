"""Measurement campaigns: files, data checks, sensor models, unknown parameters, predicted signals, comparison."""
