"""Time integration: the step, single runs, batches of trajectories, energy balance and metrics."""
