"""The equations of the rigs, one module per section; each equation is written once and shared by all rigs.

A function takes the machine `m`, the state `y` and the signals `s` known so far. It adds the signals it determines
and, if its name ends in `_rates`, returns the rates of its states.
"""
