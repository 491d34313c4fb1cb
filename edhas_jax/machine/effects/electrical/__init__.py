"""Effects of coil, amplifier and supply."""
