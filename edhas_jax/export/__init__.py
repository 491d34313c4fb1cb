"""The machine as a functional mock-up unit (FMI)."""
