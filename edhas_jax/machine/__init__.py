"""The machine model: components, effects, the equations that join them, and access to parameters by name."""
