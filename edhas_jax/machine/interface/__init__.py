"""What components, effects and controllers may rely on: signals, slots and base classes."""
