"""Many designs of one machine, each run to its periodic state."""
