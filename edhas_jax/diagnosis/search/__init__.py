"""The search for sets of effects that a model lacks: their probabilities, and the diagnosis that follows."""
