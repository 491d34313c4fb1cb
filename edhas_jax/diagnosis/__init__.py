"""Which physical effect is missing: calibration, search, planning of experiments and the report."""
