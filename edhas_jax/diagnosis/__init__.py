"""Which physical effect is missing: candidates, laws as curves, search, planning of experiments, reports."""
