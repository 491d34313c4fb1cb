"""The metrics and the trajectories of a machine as functions that JAX transforms."""
