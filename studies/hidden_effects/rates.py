"""What the cases of the benchmark of hidden effects add up to: rates with intervals, the table, the pictures."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

from edhas_jax.machine.effects import LIBRARY

Result = dict[str, Any]
SURE = 0.95  # stated probability from which an answer counts as sure
BANDS = (60.0, 1e3, 1e4, 1e5, math.inf)  # of visibility, χ²
CLOSE, ERRORS = 0.1, 2.0  # a fitted parameter is right within that share of its value, or that many standard errors
NAMED = ("missing_effect", "ambiguous")
TOOL = "edhas diagnose"


@dataclasses.dataclass(frozen=True)
class Rate:
    """How many of how many."""

    right: int
    of: int

    def interval(self, z: float = 1.96) -> tuple[float, float]:
        """Wilson's interval of 95 %: (p + z²/2n ± z √(p(1−p)/n + z²/4n²)) / (1 + z²/n)."""
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
    """The share of the results of which something is true."""
    return Rate(sum(map(right, results)), len(results))


def names(r: Result) -> list[str]:
    """What was hidden."""
    return [h["name"] for h in r["hidden"]]


def slots_of(name: str) -> set[str]:
    """The parts of the machine on which what is so named acts."""
    if " on " in name:
        return {"sensor"}
    return next(({slot.location for slot in kind.slots} for kind in LIBRARY if kind.id == name), set())


def answers(r: Result, who: str) -> list[str]:
    """The names that were answered, the first one first; none where nothing is said to be missing, or unknown."""
    if who != TOOL:
        return r["rivals"][who]
    return r["accepted"] if r["verdict"] in NAMED else []


def named(r: Result, who: str) -> bool:
    """Whether the first answer is what was hidden, or one of a stated pair that cannot be told apart is."""
    said = answers(r, who)
    if not said:
        return False
    pairs = [g for g in r["groups"] if len(g) == 2 and g[0] == said[0]] if who == TOOL else []
    return bool(set(names(r)) & {said[0], *(n for g in pairs for n in g)})


def among_three(r: Result, who: str) -> bool:
    """Whether what was hidden is among the three most probable."""
    said = answers(r, who)
    if who == TOOL and said:
        said = [n for n, _ in r["candidates"]]
    return bool(set(names(r)) & set(said[:3]))


def in_place(r: Result, who: str) -> bool:
    """Whether the part of the machine is right."""
    there = {s for h in r["hidden"] for s in h["slots"]}
    if who == TOOL:
        return r["verdict"] != "adequate" and next(iter(r["where"]), "") in there
    said = answers(r, who)
    return bool(said and slots_of(said[0]) & there)


def all_named(r: Result, who: str) -> bool:
    """Whether everything that was hidden was answered, pairs that cannot be told apart counting as either."""
    said = set(answers(r, who))
    if who == TOOL:
        said |= {n for g in r["groups"] if len(g) == 2 and g[0] in said for n in g}
    return set(names(r)) <= said


def sure_answers(results: list[Result]) -> Rate:
    """Of the answers with a stated probability of at least `SURE`, how many are right."""
    sure = [(n in names(r) and r["family"] != "struck") for r in results for n, p in r["candidates"] if p >= SURE]
    return Rate(sum(sure), len(sure))


def sized(results: list[Result]) -> Rate:
    """Of the fitted parameters of effects that were rightly named, how many are close to what was hidden."""
    found = []
    for r in results:
        for h in r["hidden"]:
            for n, (value, std) in r["parameters"].get(h["name"], {}).items():
                if n in h["values"]:
                    off = abs(value - h["values"][n])
                    found.append(off <= max(CLOSE * abs(h["values"][n]), ERRORS * std))
    return Rate(sum(found), len(found))


def rates(results: list[Result], who: str) -> dict[str, Rate]:
    """Every rate of one method."""
    of = {f: [r for r in results if r["family"] == f] for f in ("null", "one", "sensor", "pair", "struck")}
    out = {
        "right name first": rate(of["one"], lambda r: named(r, who)),
        "right name among three": rate(of["one"], lambda r: among_three(r, who)),
        "right part of the machine": rate(of["one"] + of["sensor"], lambda r: in_place(r, who)),
        "right sensor and fault": rate(of["sensor"], lambda r: named(r, who)),
        "both of two": rate(of["pair"], lambda r: all_named(r, who)),
        "at least one of two": rate(of["pair"], lambda r: bool(set(names(r)) & set(answers(r, who)))),
    }
    if who != TOOL:
        return out | {"false alarms": rate(of["null"], lambda r: bool(answers(r, who)))}
    unknown = [r for r in of["struck"] if r["verdict"] == "unknown_effect"]
    return out | {
        "false alarms": rate(of["null"], lambda r: r["verdict"] != "adequate"),
        "struck called unknown": Rate(len(unknown), len(of["struck"])),
        "right part when struck": rate(of["struck"], lambda r: in_place(r, who)),
        "right part when called unknown": rate(unknown, lambda r: in_place(r, who)),
        "right when 95 % sure": sure_answers(results),
        "parameters right": sized(of["one"]),
    }


def sound(results: list[Result]) -> list[Result]:
    """The results of the cases that ran through."""
    return [r for r in results if "failed" not in r]


def report(results: list[Result]) -> str:
    """The table of all rates, by visibility too, and the cases that went wrong."""
    done = sound(results)
    if not done:
        return "no case was finished"
    tables = {who: rates(done, who) for who in (TOOL, *done[0]["rivals"])}
    lines = [f"{len(done)} cases, {len(results) - len(done)} failed; rates with Wilson's 95 % intervals", ""]
    for what in tables[TOOL]:
        lines.append(what)
        lines += [f"    {who:30s} {table[what]}" for who, table in tables.items() if what in table]
    lines += ["", f"right name first, {TOOL}, by visibility (χ² that the uncertain parameters cannot take up)"]
    one = [r for r in done if r["family"] == "one"]
    for low, high in zip(BANDS, BANDS[1:], strict=False):
        band = [r for r in one if low <= r["hidden"][0]["visible"] < high]
        lines.append(f"    {low:>8.0f} … {high:<8.0f} {rate(band, lambda r: named(r, TOOL))}")
    lines += ["", "what went wrong"]
    lines += [f"    {sentence}" for r in results if (sentence := wrong(r))]
    seconds = sorted(r["seconds"] for r in done)
    return "\n".join([*lines, "", f"median time of a diagnosis: {seconds[len(seconds) // 2]:.0f} s"])


def wrong(r: Result) -> str:
    """What is wrong with an answer, or nothing."""
    if "failed" in r:
        return f"case {r['number']}: {r['failed']}"
    right = {
        "null": r["verdict"] == "adequate",
        "struck": r["verdict"] == "unknown_effect" and in_place(r, TOOL),
    }.get(r["family"], r["verdict"] in NAMED and set(names(r)) == set(answers(r, TOOL)))
    if right:
        return ""
    told = " + ".join(f"{h['name']} {_numbers(h['values'])}, χ² {h['visible']:.3g}" for h in r["hidden"]) or "nothing"
    after = r["errors"]["after"]["holdout"]
    trials = "; ".join(
        ", ".join(f"{name} {gain:.0f}" for name, _, gain, _ in sorted(trials, key=lambda t: -t[2])[:3])
        for trials in r["rounds"]
        if trials
    )
    said = f"{r['verdict']} {' + '.join(r['accepted'])}".strip()
    return f"case {r['number']} ({r['family']}): {told} → {said}, left over {after:.3f}; gains {trials or 'none tried'}"


def _numbers(values: dict[str, float]) -> str:
    return "(" + ", ".join(f"{v:.3g}" for v in values.values()) + ")"


def last_line(results: list[Result]) -> str:
    """The rates that matter most, in one line."""
    found = rates(sound(results), TOOL)
    named = {
        "top1": "right name first", "false_alarms": "false alarms", "slot": "right part of the machine",
        "both": "both of two", "unknown": "struck called unknown", "calibration": "right when 95 % sure",
    }  # fmt: skip
    words = []
    for short, what in named.items():
        r = found[what]
        words.append(f"{short}={r.right / r.of:.3f}" if r.of else f"{short}=nan")
    return " ".join(words)
