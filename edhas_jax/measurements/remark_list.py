"""A short list of remarks on a campaign's files: equal ones of several files together, the most serious first."""

from collections.abc import Iterable

from edhas_jax.measurements.campaign import Remark, Severity

MAX_LINES = 10
MAX_FILES = 3  # that are named beside the first one


def brief_lines(remarks: Iterable[Remark]) -> list[str]:
    """At most `MAX_LINES` lines of text.

    Args:
        remarks: the remarks on the files of a campaign.

    Returns:
        Errors first, then warnings, then notes; the last line says how many more there are and where to find them.
    """
    together: dict[tuple[Severity, str], list[Remark]] = {}
    for remark in remarks:
        together.setdefault((remark.severity, remark.sentence), []).append(remark)
    order = list(Severity)
    groups = sorted(together.values(), key=lambda group: order.index(group[0].severity))
    shown = groups if len(groups) <= MAX_LINES else groups[: MAX_LINES - 1]
    lines = [_line(group) for group in shown]
    if len(shown) < len(groups):
        lines.append(f"and {len(groups) - len(shown)} more remarks; `edhas campaign check` lists all")
    return lines


def _line(group: list[Remark]) -> str:
    """A remark, and the other files that it applies to."""
    first = group[0]
    files = list(dict.fromkeys(remark.file.name for remark in group if remark.file != first.file))
    if not files:
        return str(first)
    more = f" and {len(files) - MAX_FILES} more" if len(files) > MAX_FILES else ""
    return f"{first} (also {', '.join(files[:MAX_FILES])}{more})"
