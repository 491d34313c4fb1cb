"""The methods that the diagnosis is compared with, and what they compute from a calibrated case."""
