"""Evaluate the results of the benchmark of hidden effects: rates of right answers with confidence intervals.

A case in which a method ended in an error counts as wrong: as a false alarm where nothing is hidden, as not found
elsewhere. Only rates over stated probabilities and fitted parameters leave it out, because it states none.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from edhas_jax.machine.effects import LIBRARY
from studies.hidden_effects.cases import Family, family_of

Result = dict[str, Any]
CONFIDENT_PROBABILITY = 0.95  # stated probability from which an answer is tested for its calibration
VISIBILITY_BANDS = (60.0, 1e3, 1e4, 1e5, math.inf)  # limits of χ²
MAX_RELATIVE_ERROR = 0.1  # a fitted parameter is right within this share of its true value,
MAX_STANDARD_ERRORS = 2.0  # or within this many of its standard errors
VERDICTS_WITH_NAMES = ("missing_effect", "ambiguous")
PACKAGE_METHOD = "edhas diagnose"
BIC, CORRELATION, SPARSE = "forward selection by BIC", "residual correlation", "sparse regression (PySINDy)"
SHORT_NAMES = {BIC: "bic", CORRELATION: "correlation", SPARSE: "sparse"}  # of the baselines, in the last line


@dataclasses.dataclass(frozen=True)
class Rate:
    """A number of right answers, and the number of cases."""

    right: int
    of: int

    def interval(self, z: float = 1.96) -> tuple[float, float]:
        """Wilson's confidence interval, of 95 % by default: (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n)."""
        if not self.of:
            return 0.0, 1.0
        n, p = self.of, self.right / self.of
        half = z * math.sqrt(p * (1.0 - p) / n + z * z / (4.0 * n * n))
        middle, whole = p + z * z / (2.0 * n), 1.0 + z * z / n
        return max(0.0, (middle - half) / whole), min(1.0, (middle + half) / whole)

    def __str__(self):
        if not self.of:
            return "–"
        low, high = self.interval()
        return f"{self.right}/{self.of} = {100 * self.right / self.of:.0f} % ({100 * low:.0f} … {100 * high:.0f})"


def rate(results: list[Result], right: Callable[[Result], bool]) -> Rate:
    """The rate of results for which `right` is true."""
    return Rate(sum(map(right, results)), len(results))


def hidden_names(r: Result) -> list[str]:
    """The names of the hidden effects and faults of a result."""
    return [h["name"] for h in r.get("hidden", [])]


def family_name(r: Result) -> str:
    """The family of a result; of a case that ended in an error before it was drawn, that of its number."""
    return r.get("family", family_of(r["number"]).value)


def has_failed(r: Result, method: str) -> bool:
    """Whether a method has no answer to a case, because it ended in an error."""
    return "verdict" not in r if method == PACKAGE_METHOD else method not in r.get("rivals", {})


def methods_in(results: list[Result]) -> list[str]:
    """The methods that some results are of, the package's own first."""
    package = [PACKAGE_METHOD] if any("verdict" in r or "failed" in r for r in results) else []
    return [*package, *dict.fromkeys(method for r in results for method in r.get("rivals", {}))]


def slots_of(name: str) -> set[str]:
    """The components of the machine on which an effect or fault acts, by its name."""
    if " on " in name:
        return {"sensor"}
    return next(({slot.location for slot in kind.slots} for kind in LIBRARY if kind.id == name), set())


def answers(r: Result, method: str) -> list[str]:
    """The names that a method answered, best first; none where it found nothing missing, or an unknown effect."""
    if has_failed(r, method):
        return []
    if method != PACKAGE_METHOD:
        return r["rivals"][method]["named"]
    return r["accepted"] if r["verdict"] in VERDICTS_WITH_NAMES else []


def is_right_null(r: Result, method: str) -> bool:
    """Whether a method says that nothing is missing."""
    if has_failed(r, method):
        return False
    return r["verdict"] == "adequate" if method == PACKAGE_METHOD else not answers(r, method)


def is_named(r: Result, method: str) -> bool:
    """Whether the first answer is hidden, or the other one of a stated pair that cannot be distinguished."""
    answered = answers(r, method)
    if not answered:
        return False
    pairs = [g for g in r["groups"] if len(g) == 2 and g[0] == answered[0]] if method == PACKAGE_METHOD else []
    return bool(set(hidden_names(r)) & {answered[0], *(n for g in pairs for n in g)})


def is_among_three(r: Result, method: str) -> bool:
    """Whether a hidden effect is among the three most probable answers."""
    answered = answers(r, method)
    if answered:
        answered = [n for n, _ in r["candidates"]] if method == PACKAGE_METHOD else r["rivals"][method]["ranked"]
    return bool(set(hidden_names(r)) & set(answered[:3]))


def component_is_right(r: Result, method: str) -> bool:
    """Whether the component of the machine is right."""
    if has_failed(r, method):
        return False
    components = {s for h in r["hidden"] for s in h["slots"]}
    if method == PACKAGE_METHOD:
        return r["verdict"] != "adequate" and next(iter(r["where"]), "") in components
    answered = answers(r, method)
    return bool(answered and slots_of(answered[0]) & components)


def all_are_named(r: Result, method: str) -> bool:
    """Whether all hidden effects were answered; of a pair that cannot be distinguished either counts."""
    if has_failed(r, method):
        return False
    answered = set(answers(r, method))
    if method == PACKAGE_METHOD:
        answered |= {n for g in r["groups"] if len(g) == 2 and g[0] in answered for n in g}
    return set(hidden_names(r)) <= answered


def names_exactly(r: Result, method: str) -> bool:
    """Whether a method named all that is hidden and nothing else."""
    return all_are_named(r, method) and len(answers(r, method)) == len(hidden_names(r))


def confident_answers(results: list[Result]) -> Rate:
    """The rate of right answers among those with a probability of at least `CONFIDENT_PROBABILITY`."""
    is_right = [
        n in hidden_names(r) and r["family"] != Family.WITHHELD.value
        for r in results
        for n, probability in r.get("candidates", [])
        if probability >= CONFIDENT_PROBABILITY
    ]
    return Rate(sum(is_right), len(is_right))


def right_parameters(results: list[Result]) -> Rate:
    """The rate of fitted parameters close to their true values, for the effects that were named rightly."""
    is_right = []
    for r in results:
        for h in r["hidden"] if "verdict" in r else []:
            for n, (value, std) in r["parameters"].get(h["name"], {}).items():
                if n in h["values"]:
                    error = abs(value - h["values"][n])
                    is_right.append(error <= max(MAX_RELATIVE_ERROR * abs(h["values"][n]), MAX_STANDARD_ERRORS * std))
    return Rate(sum(is_right), len(is_right))


def rates(results: list[Result], method: str) -> dict[str, Rate]:
    """Every rate of one method, by its label."""
    of = {family: [r for r in results if family_name(r) == family.value] for family in Family}
    out = {
        "right name first": rate(of[Family.ONE], lambda r: is_named(r, method)),
        "right name among three": rate(of[Family.ONE], lambda r: is_among_three(r, method)),
        "right component of the machine": rate(
            of[Family.ONE] + of[Family.SENSOR], lambda r: component_is_right(r, method)
        ),
        "right sensor and fault": rate(of[Family.SENSOR], lambda r: is_named(r, method)),
        "both of two": rate(of[Family.PAIR], lambda r: all_are_named(r, method)),
        "at least one of two": rate(of[Family.PAIR], lambda r: bool(set(hidden_names(r)) & set(answers(r, method)))),
        "nothing but what is hidden": rate(
            of[Family.ONE] + of[Family.SENSOR] + of[Family.PAIR], lambda r: names_exactly(r, method)
        ),
        "false alarms": rate(of[Family.NULL], lambda r: not is_right_null(r, method)),
    }
    if method != PACKAGE_METHOD:
        return out
    unknown = [r for r in of[Family.WITHHELD] if r.get("verdict") == "unknown_effect"]
    return out | {
        "withheld effect reported as unknown": Rate(len(unknown), len(of[Family.WITHHELD])),
        "right component, of all withheld effects": rate(of[Family.WITHHELD], lambda r: component_is_right(r, method)),
        "right component, of those reported as unknown": rate(unknown, lambda r: component_is_right(r, method)),
        "right where the probability is at least 95 %": confident_answers(results),
        "parameters right": right_parameters(of[Family.ONE]),
    }


def report(results: list[Result]) -> str:
    """A text with all rates, the rates by visibility, and the wrong answers."""
    tables = {method: rates(results, method) for method in methods_in(results)}
    if not tables:
        return "no case was finished"
    failed = sum("failed" in r for r in results)
    lines = [f"{len(results)} cases, {failed} failed (counted as wrong); rates with Wilson's 95 % intervals", ""]
    for label in next(iter(tables.values())):
        lines.append(label)
        lines += [f"    {method:30s} {table[label]}" for method, table in tables.items() if label in table]
    for method in tables:
        lines += ["", f"right name first, {method}, by visibility (χ² that the uncertain parameters cannot explain)"]
        one = [r for r in results if family_name(r) == Family.ONE.value and r.get("hidden")]
        for low, high in zip(VISIBILITY_BANDS, VISIBILITY_BANDS[1:], strict=False):
            band = [r for r in one if low <= r["hidden"][0]["visible"] < high]
            lines.append(f"    {low:>8.0f} … {high:<8.0f} {rate(band, lambda r, m=method: is_named(r, m))}")
    if PACKAGE_METHOD in tables:
        lines += ["", "wrong answers", *(f"    {sentence}" for r in results if (sentence := wrong_answer(r)))]
    seconds = sorted(r["seconds"] for r in results if "seconds" in r)
    what = "of a diagnosis" if PACKAGE_METHOD in tables else "of all baseline methods together, calibration included"
    return "\n".join([*lines, "", f"median time {what}: {seconds[len(seconds) // 2] if seconds else 0.0:.0f} s"])


def wrong_answer(r: Result) -> str:
    """A sentence on a wrong answer; empty for a right one."""
    if "failed" in r:
        return f"case {r['number']}: {r['failed']}"
    right = {
        Family.NULL.value: r["verdict"] == "adequate",
        Family.WITHHELD.value: r["verdict"] == "unknown_effect" and component_is_right(r, PACKAGE_METHOD),
    }.get(r["family"], r["verdict"] in VERDICTS_WITH_NAMES and set(hidden_names(r)) == set(answers(r, PACKAGE_METHOD)))
    if right:
        return ""
    truth = " + ".join(f"{h['name']} {_numbers(h['values'])}, χ² {h['visible']:.3g}" for h in r["hidden"]) or "nothing"
    after = r["errors"]["after"]["holdout"]
    trials = "; ".join(
        ", ".join(f"{name} {gain:.0f}" for name, _, gain, _ in sorted(trials, key=lambda t: -t[2])[:3])
        for trials in r["rounds"]
        if trials
    )
    answered = f"{r['verdict']} {' + '.join(r['accepted'])}".strip()
    outcome = f"{truth} → {answered}, residual over noise {after:.3f}; gains {trials or 'none tried'}"
    return f"case {r['number']} ({r['family']}): {outcome}"


def _numbers(values: dict[str, float]) -> str:
    return "(" + ", ".join(f"{v:.3g}" for v in values.values()) + ")"


def last_line(results: list[Result]) -> str:
    """The most important rates in one line of `key=value`; those of the baselines where nothing else was run."""
    labels = {
        "top1": "right name first", "false_alarms": "false alarms", "slot": "right component of the machine",
        "both": "both of two", "unknown": "withheld effect reported as unknown",
        "calibration": "right where the probability is at least 95 %",
    }  # fmt: skip
    methods, words = methods_in(results), []
    for method in [PACKAGE_METHOD] if PACKAGE_METHOD in methods else methods:
        found, prefix = rates(results, method), "" if method == PACKAGE_METHOD else SHORT_NAMES[method] + "_"
        for key, label in labels.items():
            if label in found:
                r = found[label]
                words.append(f"{prefix}{key}={r.right / r.of:.3f}" if r.of else f"{prefix}{key}=nan")
    return " ".join(words)
