"""Further laws for development: the tuning laws are few, and a method can be tuned to them without being any better."""
