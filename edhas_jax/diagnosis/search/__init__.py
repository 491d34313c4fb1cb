"""The search for missing effects."""
