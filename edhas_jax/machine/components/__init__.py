"""The parts of the machine: each its parameters and its own equation, none knowing the others."""






PAPER = "Actuators 2022, 11(10), 281, Table 1"
