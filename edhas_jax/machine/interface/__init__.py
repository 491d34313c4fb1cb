"""The interface of components, effects and controllers to the equations: signals, slots and the controller base."""
