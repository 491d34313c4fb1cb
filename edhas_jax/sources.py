"""Citations that many declarations share."""

PAPER = "Actuators 2022, 11(10), 281, Table 1"
