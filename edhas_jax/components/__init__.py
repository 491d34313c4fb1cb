"""The parts of the machine: each its parameters and its own equation, none knowing the others."""
