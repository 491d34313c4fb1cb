"""The tables of the benchmark as text, and its last line."""

import math
from collections.abc import Callable, Sequence

from studies.hidden_effects.answers import Answer, Truth
from studies.hidden_effects.methods import Method
from studies.hidden_effects.rates import (
    Answered,
    answered,
    answered_by_all,
    by_strength,
    by_visibility,
    first_is_right,
    is_named,
    is_null,
    mean_set_size,
    names_exactly,
    names_wrong_effect,
    rates,
    times,
)
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.store import Record

KEYS = {
    "top1": "right name first", "in_set": "truth in the set", "place": "right place",
    "both": "both of two hidden effects named", "both_clear": "both of two hidden effects named, which stand out",
    "both_rest": "both of two hidden effects named, the rest",
    "all_three": "all three hidden effects named", "three_clear": "all three hidden effects named, which stand out",
    "three_rest": "all three hidden effects named, the rest",
    "wrong_on_nulls": "a wrong effect named where nothing is hidden",
    "adequate_on_nulls": "`adequate` where nothing is hidden",
    "unknown": "effect withheld from the library reported as unknown",
    "unknown_place": "right place stated for an effect reported as unknown",
    "law": "right statement whether the law is that of the library",
}  # fmt: skip
SLOWEST = 3


def methods_in(records: Sequence[Record]) -> list[Method]:
    """The methods that have answers, in the order of `Method`."""
    return [m for m in Method if any(m.value in r.answers for r in records)]


def report(records: Sequence[Record], not_drawn: dict[str, str]) -> str:
    """All tables, in Markdown, and the wrong answers of the package's own diagnosis."""
    lines = [f"{len(records)} cases; rates with Wilson's 95 % intervals, answers that ended in an error count as wrong"]
    lines += [f"not drawn: {key}: {reason}" for key, reason in not_drawn.items()]
    methods = methods_in(records)
    if not methods:
        return "\n".join([*lines, "no answer"])
    lines += ["", *comparison(records, methods)]
    same = answered_by_all(records, [m.value for m in methods])
    if 0 < len(same) < len(records):
        lines += ["", f"the {len(same)} cases that every method was run on", "", *comparison(same, methods)]
    families = sorted({r.truth.family for r in records})
    for method in methods if len(families) > 1 else ():
        lines += ["", f"{method.title}, by family", "", *by_family(records, method, families)]
    lines += ["", "right name first over the visible size (χ² that the uncertain parameters cannot explain)", ""]
    lines += band_table(records, methods, by_visibility)
    lines += ["", "hidden effects named over what each explains in addition to the others, over what is left", ""]
    lines += band_table(records, methods, by_strength)
    for method in methods:
        lines += ["", f"{method.title}, time by bench", "", *time_table(answered(records, method.value))]
    if Method.OURS in methods:
        ours = answered(records, Method.OURS.value)
        lines += ["", *probability_table(ours)]
        lines += ["", "wrong answers", *(f"    {wrong_answer(t, a)}" for t, a, _ in ours if is_wrong(t, a))]
        slowest = sorted(ours, key=lambda case: -case.answer.seconds)[:SLOWEST]
        lines += ["", "slowest", *(f"    {case_name(t)}: {a.seconds:.0f} s ({description(t)})" for t, a, _ in slowest)]
    return "\n".join(lines)


def summary(cases: list[Answered]) -> dict[str, str]:
    """Every figure of the answers of one method as text, by its label."""
    found, spent = reliability(cases), times(cases)
    rows = {label: str(r) for label, r in rates(cases).items()}
    failed = sum(answer.verdict is None for _, answer, *_ in cases)
    durations = f"{spent.median:.0f} / {spent.most:.0f} / {spent.worst:.0f} s"
    error = f"{found.error:.3f} ({found.by_chance:.3f})" if found.count else "–"
    return rows | {
        "mean size of the set": _number(mean_set_size(cases), ".2f"),
        "calibration error (that of chance alone)": error,
        "processor time: median / 95th percentile / largest": durations,
        "cases (ended in an error)": f"{len(cases)} ({failed})",
    }


def comparison(records: Sequence[Record], methods: Sequence[Method]) -> list[str]:
    """The lines of a table of all figures of all methods."""
    return markdown_table([m.title for m in methods], [summary(answered(records, m.value)) for m in methods])


def by_family(records: Sequence[Record], method: Method, families: Sequence[str]) -> list[str]:
    """The lines of a table of all figures of one method in each family."""
    of = [answered([r for r in records if r.truth.family == family], method.value) for family in families]
    return markdown_table([f"({family})" for family in families], [summary(cases) if cases else {} for cases in of])


def band_table(records: Sequence[Record], methods: Sequence[Method], rates_of: Callable) -> list[str]:
    """The lines of a table of rates by the limits of bands: `by_visibility` or `by_strength`."""
    found = [rates_of(answered(records, m.value)) for m in methods]
    columns = [{f"{low:g} … {high:g}": str(r) for (low, high), r in rows.items()} for rows in found]
    return markdown_table([m.title for m in methods], columns)


def probability_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table: the share of first answers that are right, by the probability that they state."""
    rows = {f"{b.low:.1f} … {b.high:.1f}": str(b.right) for b in reliability(cases).bins}
    return ["right first answers over their stated probability", "", *markdown_table(["right"], [rows])]


def time_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table of computing times by bench; a case's description begins with the name of its bench."""
    benches: dict[str, list[Answered]] = {}
    for of in cases:
        benches.setdefault(of.truth.description.partition(":")[0], []).append(of)
    spent = {bench: times(benches[bench]) for bench in sorted(benches)}
    columns = {
        "cases": {bench: str(len(benches[bench])) for bench in spent},
        "median": {bench: f"{s.median:.0f} s" for bench, s in spent.items()},
        "95th percentile": {bench: f"{s.most:.0f} s" for bench, s in spent.items()},
        "largest": {bench: f"{s.worst:.0f} s" for bench, s in spent.items()},
    }
    return markdown_table(list(columns), list(columns.values()))


def markdown_table(heads: list[str], columns: list[dict[str, str]]) -> list[str]:
    """Markdown of columns of labelled cells, without the rows that are empty in all of them."""
    labels = dict.fromkeys(label for column in columns for label in column)
    lines = ["| | " + " | ".join(heads) + " |", "| --- |" + " --- |" * len(heads)]
    for label in labels:
        cells = [column.get(label, "–") for column in columns]
        if set(cells) != {"–"}:
            lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return lines


def is_wrong(truth: Truth, answer: Answer) -> bool:
    """Whether a reader should look at an answer: a wrong first answer, not all that is hidden, or more than that."""
    if is_null(truth):
        return not first_is_right(truth, answer) or names_wrong_effect(truth, answer)
    return not (names_exactly(truth, answer) if is_named(truth) else first_is_right(truth, answer))


def wrong_answer(truth: Truth, answer: Answer) -> str:
    """A sentence on an answer and on what is hidden."""
    hidden = " + ".join(f"{h.name} ({h.law.value}, χ² {h.visible:.3g})" for h in truth.hidden) or "nothing"
    hidden += " (withheld)" if truth.withheld else ""
    said = answer.failed or f"{answer.verdict.value} {' + '.join(answer.named)}".strip()
    place = f" at {answer.place}" if answer.place else ""
    return f"{case_name(truth)}: {hidden} → {said}{place}, set {', '.join(sorted(answer.members)) or 'none'}"


def case_name(truth: Truth) -> str:
    """Family and number of a case."""
    return f"{truth.family}{truth.number:05d}"


def description(truth: Truth) -> str:
    """What is hidden and what else differs."""
    return "; ".join(filter(None, [" + ".join(h.name for h in truth.hidden) or "nothing hidden", truth.description]))


def _number(value: float, form: str) -> str:
    return "–" if math.isnan(value) else format(value, form)


def last_line(records: Sequence[Record]) -> str:
    """The most important figures of each method in one line of `key=value`."""
    words = []
    for method in methods_in(records):
        cases = answered(records, method.value)
        found, spent = rates(cases), times(cases)
        figures = {key: (found[label].share, ".3f") for key, label in KEYS.items()}
        figures |= {
            "set_size": (mean_set_size(cases), ".2f"), "calibration_error": (reliability(cases).error, ".3f"),
            "median_s": (spent.median, ".0f"), "most_s": (spent.most, ".0f"), "worst_s": (spent.worst, ".0f"),
        }  # fmt: skip
        words += [f"{method.value}_{key}={value:{form}}" for key, (value, form) in figures.items()]
    return " ".join(words)
