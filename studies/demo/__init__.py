"""A first run of the machine, and a first diagnosis of a missing effect."""
