"""Generators of campaigns that resemble a bench: other laws, small unlisted physics, sensor chains, several effects.

`drawing.draw_case` draws a case by family, split and number. What a case is made of is in the packages `tuning` and
`judging`, which have no law, small disturbance, sensor chain or bench in common: thresholds may be tuned with the
first, and the second judge.
"""
