"""Suggestions for mistyped names."""

import difflib


def suggest(name: str, valid) -> str:
    """A clause for an error message: the valid names most similar to `name`, or all of them if none is similar."""
    close = difflib.get_close_matches(name, list(valid), n=3, cutoff=0.6)
    return ("nearest: " if close else "valid: ") + ", ".join(close or sorted(valid))
