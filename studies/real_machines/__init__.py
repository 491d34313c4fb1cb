"""Machines that others have measured, from the plain model to the error on records that were not used."""
