"""Which parameters can be identified on the bench, and do the error bars of a fit hold?"""
