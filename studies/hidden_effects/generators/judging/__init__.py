"""What the judging cases are made of; no law, disturbance, link, drift, sheet, run or machine is in another split."""

from studies.hidden_effects.generators.judging import (
    benches,
    chains,
    disturbances,
    first_machine,
    laws,
    second_machine,
    settings,
    unlisted,
)

__all__ = [
    "benches", "chains", "disturbances", "first_machine", "laws", "second_machine", "settings", "unlisted",
]  # fmt: skip
