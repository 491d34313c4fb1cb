"""Generators of campaigns that resemble a bench: other laws, small disturbances, sensor chains, several effects.

`drawing.draw_case` draws a case by family, split and number. What a case is made of is in one package for each split.
`judging` has no law, small disturbance, sensor chain or bench in common with `tuning`, `practice`, `varied` and
`earlier`: methods may be developed with these four, and the cases of the first judge them. `earlier` is a judging set
whose wrong answers have been looked at.
"""
