"""Time loops as kernels for NVIDIA GPUs: one thread per lane, and the whole loop in one kernel."""
