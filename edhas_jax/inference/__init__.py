"""What measurements say of the parameters of a model: their likelihood, and the fits that maximise it."""
