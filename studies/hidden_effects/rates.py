"""Evaluate the results of the benchmark of hidden effects: rates of right answers with confidence intervals."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from edhas_jax.machine.effects import LIBRARY
from studies.hidden_effects.cases import Family

Result = dict[str, Any]
CONFIDENT_PROBABILITY = 0.95  # stated probability from which an answer is tested for its calibration
VISIBILITY_BANDS = (60.0, 1e3, 1e4, 1e5, math.inf)  # limits of χ²
MAX_RELATIVE_ERROR = 0.1  # a fitted parameter is right within this share of its true value,
MAX_STANDARD_ERRORS = 2.0  # or within this many of its standard errors
VERDICTS_WITH_NAMES = ("missing_effect", "ambiguous")
PACKAGE_METHOD = "edhas diagnose"


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
    return [h["name"] for h in r["hidden"]]


def slots_of(name: str) -> set[str]:
    """The components of the machine on which an effect or fault acts, by its name."""
    if " on " in name:
        return {"sensor"}
    return next(({slot.location for slot in kind.slots} for kind in LIBRARY if kind.id == name), set())


def answers(r: Result, method: str) -> list[str]:
    """The names that a method answered, best first; none where it found nothing missing, or an unknown effect."""
    if method != PACKAGE_METHOD:
        return r["rivals"][method]
    return r["accepted"] if r["verdict"] in VERDICTS_WITH_NAMES else []


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
    if method == PACKAGE_METHOD and answered:
        answered = [n for n, _ in r["candidates"]]
    return bool(set(hidden_names(r)) & set(answered[:3]))


def component_is_right(r: Result, method: str) -> bool:
    """Whether the component of the machine is right."""
    components = {s for h in r["hidden"] for s in h["slots"]}
    if method == PACKAGE_METHOD:
        return r["verdict"] != "adequate" and next(iter(r["where"]), "") in components
    answered = answers(r, method)
    return bool(answered and slots_of(answered[0]) & components)


def all_are_named(r: Result, method: str) -> bool:
    """Whether all hidden effects were answered; of a pair that cannot be distinguished either counts."""
    answered = set(answers(r, method))
    if method == PACKAGE_METHOD:
        answered |= {n for g in r["groups"] if len(g) == 2 and g[0] in answered for n in g}
    return set(hidden_names(r)) <= answered


def confident_answers(results: list[Result]) -> Rate:
    """The rate of right answers among those with a probability of at least `CONFIDENT_PROBABILITY`."""
    is_right = [
        n in hidden_names(r) and r["family"] != Family.WITHHELD.value
        for r in results
        for n, probability in r["candidates"]
        if probability >= CONFIDENT_PROBABILITY
    ]
    return Rate(sum(is_right), len(is_right))


def right_parameters(results: list[Result]) -> Rate:
    """The rate of fitted parameters close to their true values, for the effects that were named rightly."""
    is_right = []
    for r in results:
        for h in r["hidden"]:
            for n, (value, std) in r["parameters"].get(h["name"], {}).items():
                if n in h["values"]:
                    error = abs(value - h["values"][n])
                    is_right.append(error <= max(MAX_RELATIVE_ERROR * abs(h["values"][n]), MAX_STANDARD_ERRORS * std))
    return Rate(sum(is_right), len(is_right))


def rates(results: list[Result], method: str) -> dict[str, Rate]:
    """Every rate of one method, by its label."""
    of = {family: [r for r in results if r["family"] == family.value] for family in Family}
    out = {
        "right name first": rate(of[Family.ONE], lambda r: is_named(r, method)),
        "right name among three": rate(of[Family.ONE], lambda r: is_among_three(r, method)),
        "right component of the machine": rate(
            of[Family.ONE] + of[Family.SENSOR], lambda r: component_is_right(r, method)
        ),
        "right sensor and fault": rate(of[Family.SENSOR], lambda r: is_named(r, method)),
        "both of two": rate(of[Family.PAIR], lambda r: all_are_named(r, method)),
        "at least one of two": rate(of[Family.PAIR], lambda r: bool(set(hidden_names(r)) & set(answers(r, method)))),
    }
    if method != PACKAGE_METHOD:
        return out | {"false alarms": rate(of[Family.NULL], lambda r: bool(answers(r, method)))}
    unknown = [r for r in of[Family.WITHHELD] if r["verdict"] == "unknown_effect"]
    return out | {
        "false alarms": rate(of[Family.NULL], lambda r: r["verdict"] != "adequate"),
        "withheld effect reported as unknown": Rate(len(unknown), len(of[Family.WITHHELD])),
        "right component, of all withheld effects": rate(of[Family.WITHHELD], lambda r: component_is_right(r, method)),
        "right component, of those reported as unknown": rate(unknown, lambda r: component_is_right(r, method)),
        "right where the probability is at least 95 %": confident_answers(results),
        "parameters right": right_parameters(of[Family.ONE]),
    }


def completed(results: list[Result]) -> list[Result]:
    """The results of the cases that did not fail."""
    return [r for r in results if "failed" not in r]


def report(results: list[Result]) -> str:
    """A text with all rates, the rates by visibility, and the wrong answers."""
    done = completed(results)
    if not done:
        return "no case was finished"
    tables = {method: rates(done, method) for method in (PACKAGE_METHOD, *done[0]["rivals"])}
    lines = [f"{len(done)} cases, {len(results) - len(done)} failed; rates with Wilson's 95 % intervals", ""]
    for label in tables[PACKAGE_METHOD]:
        lines.append(label)
        lines += [f"    {method:30s} {table[label]}" for method, table in tables.items() if label in table]
    lines += [
        "",
        f"right name first, {PACKAGE_METHOD}, by visibility (χ² that the uncertain parameters cannot explain)",
    ]
    one = [r for r in done if r["family"] == Family.ONE.value]
    for low, high in zip(VISIBILITY_BANDS, VISIBILITY_BANDS[1:], strict=False):
        band = [r for r in one if low <= r["hidden"][0]["visible"] < high]
        lines.append(f"    {low:>8.0f} … {high:<8.0f} {rate(band, lambda r: is_named(r, PACKAGE_METHOD))}")
    lines += ["", "wrong answers"]
    lines += [f"    {sentence}" for r in results if (sentence := wrong_answer(r))]
    seconds = sorted(r["seconds"] for r in done)
    return "\n".join([*lines, "", f"median time of a diagnosis: {seconds[len(seconds) // 2]:.0f} s"])


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
    """The most important rates in one line of `key=value`."""
    found = rates(completed(results), PACKAGE_METHOD)
    labels = {
        "top1": "right name first", "false_alarms": "false alarms", "slot": "right component of the machine",
        "both": "both of two", "unknown": "withheld effect reported as unknown",
        "calibration": "right where the probability is at least 95 %",
    }  # fmt: skip
    words = []
    for key, label in labels.items():
        r = found[label]
        words.append(f"{key}={r.right / r.of:.3f}" if r.of else f"{key}=nan")
    return " ".join(words)
