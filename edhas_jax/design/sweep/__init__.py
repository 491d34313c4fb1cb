"""Sweeps over parameters: configuration, chunks, workers, folder, table and figures."""
