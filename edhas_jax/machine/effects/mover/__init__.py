"""Effects that act on the mover."""
