"""The time step, single runs and many runs side by side, energy balance and metrics."""
