"""Candidates that a model may lack, and the fits of models with them."""
