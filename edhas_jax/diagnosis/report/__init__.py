"""Presentation of a diagnosis: HTML report, figures and result files."""
