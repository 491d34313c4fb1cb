"""The physics: components, effects, the equations that join them, and parameters by name."""
