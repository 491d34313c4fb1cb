"""Time loops as kernels (programs for a GPU) of NVIDIA GPUs: a thread takes one lane through the whole loop."""
