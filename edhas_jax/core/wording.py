"""Words for messages: counted and listed things."""

from collections.abc import Sequence


def counted(count: int, thing: str) -> str:
    """A number of things: "1 sample", "3 samples"."""
    return f"{count} {thing}{'' if count == 1 else 's'}"


def listed(texts: Sequence[str], most: int) -> str:
    """The first texts, and how many more there are: "a, b and 3 more"."""
    more = f" and {len(texts) - most} more" if len(texts) > most else ""
    return ", ".join(texts[:most]) + more
