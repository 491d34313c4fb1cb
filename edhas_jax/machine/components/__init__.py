"""The components of the machine: each holds its parameters and its own equation, and none knows another."""

PAPER = "Actuators 2022, 11(10), 281, Table 1"
