"""Summary of a sweep: how many designs ended with which status, and the range of each parameter and metric."""

from collections import Counter
from collections.abc import Iterable

import numpy as np

from edhas_jax.core.summary import Summary, SummaryTable, Tone, Toned
from edhas_jax.core.units import format_result
from edhas_jax.design.sweep.table import NOT_RUN, SweepResult


def sweep_summary(result: SweepResult) -> Summary:
    """The summary of a result."""
    return summary_of_parts([result])


def summary_of_parts(parts: Iterable[SweepResult]) -> Summary:
    """The summary of a result that comes in parts; one part is in memory at a time."""
    statuses: Counter[tuple[str, str]] = Counter()
    low: dict[str, float] = {}
    high: dict[str, float] = {}
    part, total = None, 0
    for part in parts:
        total += len(part.frame)
        statuses.update(part.frame.groupby(["status", "reason"], sort=False).size().to_dict())
        for name in (*part.parameters, *part.metrics):
            values = part.frame[name].to_numpy(float)
            values = values[np.isfinite(values)]
            if len(values):
                low[name] = min(low.get(name, np.inf), values.min())
                high[name] = max(high.get(name, -np.inf), values.max())
    if part is None:
        raise ValueError("a sweep without designs")
    tones = {"ok": Tone.GOOD, NOT_RUN: Tone.CAUTION}
    counts = [(status, int(n), reason) for (status, reason), n in statuses.items()]
    rows = [(Toned(s, tones.get(s, Tone.BAD)), f"{n:,}", reason) for s, n, reason in counts]
    records = [{"status": s, "designs": n, "meaning": reason} for s, n, reason in counts]
    ranges = [
        {"name": name, "role": role, "from": low[name], "to": high[name], "unit": part.fields[name][0]}
        for role, names in (("parameter", part.parameters), ("metric", part.metrics))
        for name in names
        if name in low
    ]
    texts = []
    for r in ranges:
        about = part.fields[r["name"]]
        ends = (format_result(float(r[end]), about.unit, about.shown) for end in ("from", "to"))
        texts.append((r["name"], r["role"], *ends))
    title = f"{part.manifest.get('name') or 'sweep'}: {total:,} designs of {', '.join(part.parameters)}"
    return Summary(title, (
        SummaryTable.of("statuses", ("status", "designs", "meaning"), rows, records),
        SummaryTable.of("ranges", ("name", "", "from", "to"), texts, ranges),
    ))  # fmt: skip
