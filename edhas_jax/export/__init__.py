"""Export of a machine as a functional mock-up unit (FMU)."""
