"""How good is a sized pump, and what does the design space look like?"""
