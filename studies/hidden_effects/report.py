"""The tables of the benchmark as text, and its last line."""

import itertools
import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

from studies.hidden_effects.answers import UNKNOWN, Answer, Law, Truth, Verdict, same_as_any
from studies.hidden_effects.methods import Method
from studies.hidden_effects.rates import (
    Answered,
    answered,
    answered_by_all,
    by_visibility,
    first_is_right,
    is_named,
    is_null,
    mean_set_size,
    names_exactly,
    names_wrong_effect,
    rates,
    set_is_right,
    times,
)
from studies.hidden_effects.reliability import reliability
from studies.hidden_effects.store import Record

KEYS = {
    "top1": "right name first", "in_set": "truth in the set", "place": "right place",
    "both": "both of two hidden effects named", "all_three": "all three hidden effects named",
    "wrong_on_nulls": "a wrong effect named where nothing is hidden",
    "adequate_on_nulls": "`adequate` where nothing is hidden",
    "unknown": "effect withheld from the library reported as unknown",
    "unknown_place": "right place stated for an effect reported as unknown",
    "law": "right statement whether the law is that of the library",
}  # fmt: skip
SLOWEST = 3
FREE_GAINS = (0.0, 0.5, 2.5, 10.0, math.inf)  # limits of the bands of the relative gain
LAW_COLUMNS = ("library_error", "final_error", "calibrated", "with_library", "final")


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
    lines += visibility_table(records, methods)
    if Method.OURS in methods:
        ours = answered(records, Method.OURS.value)
        tables = outcome_table, candidate_table, free_term_table, law_table, probability_table, time_table
        for table in tables:
            lines += ["", *table(ours)]
        lines += ["", "wrong answers", *(f"    {wrong_answer(t, a)}" for t, a in ours if is_wrong(t, a))]
        slowest = sorted(ours, key=lambda case: -case[1].seconds)[:SLOWEST]
        lines += ["", "slowest", *(f"    {case_name(t)}: {a.seconds:.0f} s ({description(t)})" for t, a in slowest)]
    return "\n".join(lines)


def summary(cases: list[Answered]) -> dict[str, str]:
    """Every figure of the answers of one method as text, by its label."""
    found, spent = reliability(cases), times(cases)
    rows = {label: str(r) for label, r in rates(cases).items()}
    failed = sum(answer.verdict is None for _, answer in cases)
    durations = f"{spent.median:.0f} / {spent.ninety:.0f} / {spent.worst:.0f} s"
    error = f"{found.error:.3f} ({found.by_chance:.3f})" if found.count else "–"
    return rows | {
        "mean size of the set": _number(mean_set_size(cases), ".2f"),
        "calibration error (that of chance alone)": error,
        "processor time: median / 90th percentile / largest": durations,
        "cases (ended in an error)": f"{len(cases)} ({failed})",
    }


def comparison(records: Sequence[Record], methods: Sequence[Method]) -> list[str]:
    """The lines of a table of all figures of all methods."""
    return markdown_table([m.title for m in methods], [summary(answered(records, m.value)) for m in methods])


def by_family(records: Sequence[Record], method: Method, families: Sequence[str]) -> list[str]:
    """The lines of a table of all figures of one method in each family."""
    of = [answered([r for r in records if r.truth.family == family], method.value) for family in families]
    return markdown_table([f"({family})" for family in families], [summary(cases) if cases else {} for cases in of])


def visibility_table(records: Sequence[Record], methods: Sequence[Method]) -> list[str]:
    """The lines of a table of the rate of right first names over the visible size."""
    found = [by_visibility(answered(records, m.value)) for m in methods]
    columns = [{f"{low:.0f} … {high:.0f}": str(r) for (low, high), r in rows.items()} for rows in found]
    return markdown_table([m.title for m in methods], columns)


def outcome_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table of what was answered where an effect is hidden.

    With the visible size of the effect, and the largest share of a signal's rms that the calibrated model leaves beyond
    the noise.
    """
    groups: dict[str, list[Answered]] = {}
    for truth, answer in cases:
        if not is_null(truth):
            groups.setdefault(_outcome(truth, answer), []).append((truth, answer))
    heads = ["cases", "truth in the set", "visible size", "share of a signal left, %"]
    columns: list[dict[str, str]] = [{} for _ in heads]
    for label in sorted(groups):
        of = groups[label]
        sizes = [max(h.visible for h in truth.hidden) for truth, _ in of]
        shares = [100.0 * answer.evidence["unexplained"] for _, answer in of if answer.evidence]
        cells = str(len(of)), str(sum(set_is_right(*case) for case in of)), _quartiles(sizes), _quartiles(shares)
        for column, cell in zip(columns, cells, strict=True):
            column[label] = cell
    return ["answers where an effect is hidden: medians (quartiles)", "", *markdown_table(heads, columns)]


def _outcome(truth: Truth, answer: Answer) -> str:
    """What is hidden and what was answered, in words."""
    hidden = "nothing" if is_null(truth) else "a withheld effect" if truth.withheld else "an effect that can be named"
    if answer.verdict is None:
        return f"{hidden}: error"
    if answer.verdict is Verdict.ADEQUATE:
        return f"{hidden}: nothing is missing"
    if answer.first == UNKNOWN:
        return f"{hidden}: an effect without a name"
    is_right = not truth.withheld and first_is_right(truth, answer)
    return f"{hidden}: {'right' if is_right else 'wrong'} name"


def candidate_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table of how much each candidate in the answers explains, relative to what is left with it.

    Candidates are listed by whether they are hidden and named. Hidden effects that are no candidates follow, without
    withheld ones: some were fitted in the place of a candidate (rivals), the others do not appear in the answer.
    """
    strengths: dict[str, list[float]] = {}
    others: Counter[str] = Counter()
    for truth, answer in cases:
        members = answer.evidence.get("members", [])
        candidates = [member["name"] for member in members]
        for member in members:
            kind = "hidden" if same_as_any(member["name"], truth.names) else "not hidden"
            named = "named" if same_as_any(member["name"], answer.named) else "not named"
            strengths.setdefault(f"{kind}: candidate, {named}", []).append(member["strength"])
        rivals = {name for member in members for name in member["gains"]}
        for hidden in () if truth.withheld else truth.names:
            if not same_as_any(hidden, candidates):
                others[f"hidden: {'rival of a candidate' if same_as_any(hidden, rivals) else 'not in the answer'}"] += 1
    counts = {label: str(len(of)) for label, of in sorted(strengths.items())}
    counts |= {label: str(number) for label, number in sorted(others.items())}
    explained = {label: _quartiles(of) for label, of in strengths.items()}
    heads = ["number", "explained relative to what is left"]
    return ["candidates and hidden effects: medians (quartiles)", "", *markdown_table(heads, [counts, explained])]


def free_term_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table of the gain of the best free term, relative to the misfit left with it.

    A free term is a curve of unknown shape or a term with memory. Only answers that name no effect are counted. Where
    nothing is hidden, the gain is due to noise and small disturbances; a withheld effect can only be told from them
    if its gain is larger. The last column is the misfit of the calibrated model: the excess of χ² over the number of
    samples, per sample.
    """
    groups: dict[str, list[Answer]] = {}
    for truth, answer in cases:
        if (is_null(truth) or truth.withheld) and answer.evidence and not answer.named:
            groups.setdefault(_outcome(truth, answer), []).append(answer)
    gains = {label: [answer.evidence["free_strength"] for answer in groups[label]] for label in sorted(groups)}
    columns = {
        f"{low:g} … {high:g}": {label: str(sum(low <= gain < high for gain in of)) for label, of in gains.items()}
        for low, high in itertools.pairwise(FREE_GAINS)
    }
    columns["excess of χ² per sample"] = {
        label: _quartiles([answer.evidence["misfit"] for answer in groups[label]]) for label in gains
    }
    title = "answers that name no effect: number by relative gain of the best free term; medians (quartiles)"
    return [title, "", *markdown_table(list(columns), list(columns.values()))]


def law_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table on the laws of rightly named effects whose law is not the library's; medians over them."""
    rows = [
        (truth.family, estimate)
        for truth, answer in cases
        for name, estimate in answer.estimates.items()
        if any(h.law is Law.DIFFERS and same_as_any(name, (h.name,)) for h in truth.hidden)
    ]
    if not rows:
        return []
    of = {f"({family})": [e for other, e in rows if other == family] for family in sorted({f for f, _ in rows})}
    counts = [{label: str(len(found)) for label, found in of.items()},
              {label: str(sum(e.has_curve for e in found)) for label, found in of.items()}]  # fmt: skip
    medians = [{label: _quartiles([getattr(e, name) for e in found]) for label, found in of.items()}
               for name in LAW_COLUMNS]  # fmt: skip
    heads = ["effects", "of them with a curve", "error of the library's law", "error of the law found",
             "residual without the effect", "with the library's law", "with the law found"]  # fmt: skip
    title = "laws that are not the library's, of rightly named effects, by family: medians (quartiles)"
    return [title, "", *markdown_table(heads, counts + medians)]


def probability_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table: the share of first answers that are right, by the probability that they state."""
    rows = {f"{b.low:.1f} … {b.high:.1f}": str(b.right) for b in reliability(cases).bins}
    return ["right first answers over their stated probability", "", *markdown_table(["right"], [rows])]


def time_table(cases: Sequence[Answered]) -> list[str]:
    """The lines of a table of computing times by bench; a case's description begins with the name of its bench."""
    benches: dict[str, list[Answered]] = {}
    for truth, answer in cases:
        benches.setdefault(truth.description.partition(":")[0], []).append((truth, answer))
    spent = {bench: times(benches[bench]) for bench in sorted(benches)}
    columns = {
        "cases": {bench: str(len(benches[bench])) for bench in spent},
        "median": {bench: f"{s.median:.0f} s" for bench, s in spent.items()},
        "90th percentile": {bench: f"{s.ninety:.0f} s" for bench, s in spent.items()},
        "largest": {bench: f"{s.worst:.0f} s" for bench, s in spent.items()},
    }
    return ["time by bench", "", *markdown_table(list(columns), list(columns.values()))]


def _quartiles(values: Sequence[float]) -> str:
    if not np.isfinite(values).any():
        return "–"
    low, middle, high = np.nanpercentile(values, [25, 50, 75])
    return f"{middle:.3g} ({low:.2g} … {high:.2g})"


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
            "median_s": (spent.median, ".0f"), "worst_s": (spent.worst, ".0f"),
        }  # fmt: skip
        words += [f"{method.value}_{key}={value:{form}}" for key, (value, form) in figures.items()]
    return " ".join(words)
