"""Effects of the cylinder and its load."""
