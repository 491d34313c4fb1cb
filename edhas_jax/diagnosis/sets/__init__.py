"""A posterior over sets of effects: one evidence, one search; in work, see `search` for the diagnosis in use."""
