"""From a function of JAX to a loop over time in machine code, and the engines that run such loops."""
