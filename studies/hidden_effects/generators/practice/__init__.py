"""Laws of a second development set, which show whether a method generalises beyond the laws it was tuned on."""
