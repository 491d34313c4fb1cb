"""Generators of campaigns that resemble a bench: other laws, small disturbances, sensor chains, several effects.

`drawing.draw` draws a case by family, split and number. What a case is made of is in one package for each split.
`judging` has no law, small disturbance, sensor chain or bench in common with `tuning`, which has judged before, and
`varied`, with which methods may be developed. The generators use the machine, its simulation and the campaigns, and
nothing of the diagnosis.
"""
