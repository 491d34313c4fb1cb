"""A first run of the machine, and a first diagnosis of a missing effect."""

from pathlib import Path

CAMPAIGN = Path(__file__).parent / "campaign"
"""Four runs of a bench on which one effect of the library is missing, and all else is as the sheet says."""

BENCH = Path(__file__).parent / "bench"
"""The same runs of a bench as it is, which `studies.demo.bench_as_it_is` has written."""
