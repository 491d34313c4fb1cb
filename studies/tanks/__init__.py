"""Two water tanks in cascade: a plant of one's own whose model lacks the overflow."""
