"""What is each part of the diagnosis worth? Cases are diagnosed without one part at a time.

    python -m studies.hidden_effects.ablation [--split varied|tuning|judging] [--families b c …] [--first K] [--cases N]
                                              [--parts PART …] [--workers K] [--out DIR]

The answers of the whole method and those without a part are stored in DIR, in the same way as those of the benchmark;
where DIR is a result folder of the benchmark, those of the whole method are there already. All parts of a case run in
one process with one calibrated model.

The table: the cases in which the answer is another one without the part, those in which it is right without it only
(better), and those in which it is right with it only (worse). An answer is right where it names all that is hidden and
nothing else, and says `unknown` where that is withheld.

The last line: `cases=… PART_better=… PART_worse=… …`.
"""

import argparse
import contextlib
import dataclasses
import enum
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from unittest import mock

import numpy as np

from edhas_jax.diagnosis.search import diagnose, set_search
from edhas_jax.diagnosis.search.linear_model import FlooredModel
from edhas_jax.diagnosis.search.set_search import SetSearch
from edhas_jax.diagnosis.search.signatures import SignatureTable
from studies.hidden_effects.answers import Answer
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, Split, keys_of
from studies.hidden_effects.methods import Method, SharedParts, answer_with
from studies.hidden_effects.report import is_wrong, markdown_table
from studies.hidden_effects.store import Record, ResultFolder
from studies.hidden_effects.work import run_all


class Part(enum.Enum):
    """A part of the diagnosis, with what is left out without it, for the table."""

    LAW_DEVIATIONS = "deviations of an effect from its law, integrated out"
    ERROR_OF_LAWS = "laws err elsewhere by no more than over their variable"
    CURVES_AS_LAWS = "free curves as the law of an effect"
    EFFECTS_FOR_CURVES = "effects tried in place of a free curve at their component"
    FREE_TERMS = "free terms, so that no answer is `unknown`"
    BACKGROUND = "the background beneath the predictions"
    SIGNATURES_BESIDE = "signatures simulated again beside the best set"
    EXCHANGES = "additions to other sets than the best one (exchanges)"
    SMALLER_SETS = "the best set without each of its members, fitted from there"
    OTHER_STARTS = "further starts of a fit"
    LONGER_FITS = "fits of the best set that go on to their minimum"
    SOLVER_ERROR = "the solver's error at the estimate of each set"

    @property
    def word(self) -> str:
        """Its word on the command line, and in the names of files."""
        return self.name.lower()


@contextlib.contextmanager
def without(part: Part) -> Iterator[None]:
    """The diagnosis without a part, as long as the context lasts."""
    place, instead = _left_out(part)
    with mock.patch.multiple(place, **instead):
        yield


def _left_out(part: Part) -> tuple[object, dict[str, object]]:
    """Where a part is entered, and what takes its place there."""
    starts, begin = SetSearch._starts, SetSearch.__init__

    def first_start(self, *arguments):
        return starts(self, *arguments)[:1]

    def without_terms(self, calibrated, table, *arguments):
        begin(self, calibrated, dataclasses.replace(table, free=()), *arguments)

    match part:
        case Part.LAW_DEVIATIONS:
            return set_search, {"law_deviation_columns": lambda fit, named: []}
        case Part.ERROR_OF_LAWS:
            return FlooredModel, {"fall_by_laws": math.inf}
        case Part.CURVES_AS_LAWS:
            return SetSearch, {"_take_curves_as_laws": lambda self: None}
        case Part.EFFECTS_FOR_CURVES:
            return SetSearch, {"_may_be_law": staticmethod(lambda move, best: False)}
        case Part.FREE_TERMS:
            return SetSearch, {"__init__": without_terms}
        case Part.BACKGROUND:
            return set_search, {"SIZES": np.zeros(1)}
        case Part.SIGNATURES_BESIDE:
            return SignatureTable, {"at": lambda self, fit, without: self}
        case Part.EXCHANGES:
            return SetSearch, {"_expanded": lambda self, best: [best]}
        case Part.SMALLER_SETS:
            return SetSearch, {"_smaller": lambda self, best: []}
        case Part.OTHER_STARTS:
            return SetSearch, {"_starts": first_start, "_let_compete": lambda self: None}
        case Part.LONGER_FITS:
            return SetSearch, {"_go_on": lambda self: None}
        case Part.SOLVER_ERROR:
            return set_search, {"with_own_solver_error": lambda evaluated, *arguments: evaluated}


def file_name(part: Part) -> str:
    """The name under which answers without a part are stored."""
    return f"without_{part.word}"


@dataclasses.dataclass(frozen=True)
class Job:
    """One case to be diagnosed without parts, and where the answers go."""

    key: CaseKey
    parts: tuple[Part, ...]
    results: ResultFolder


def run_job(job: Job) -> str:
    """Diagnose a case, whole where no answer is stored, and without each part; a sentence that hides the answers."""
    stored = job.results.truth(job.key)
    case = draw(job.key, stored.attempt if stored else 0)
    if stored is None:
        job.results.store_truth(job.key, case.truth)
    with mock.patch.object(diagnose, "calibrate", _once_for_each_noise(diagnose.calibrate)):
        if job.results.missing(job.key, [Method.OURS.value]):
            job.results.store_answer(job.key, Method.OURS.value, answer_with(Method.OURS, case, SharedParts(case)))
        for part in job.parts:
            with without(part):
                answer = answer_with(Method.OURS, case, SharedParts(case))
            job.results.store_answer(job.key, file_name(part), answer)
    return f"{job.key}: without {', '.join(part.word for part in job.parts)}"


def _once_for_each_noise(calibrate: Callable) -> Callable:
    """A function that calibrates the model of one case once for each noise of its campaign, as only that changes."""
    known = {}

    def kept(campaign, report):
        noise = tuple((name, channel.noise) for name, channel in campaign.channels.items())
        if noise not in known:
            known[noise] = calibrate(campaign, report)
        return known[noise]

    return kept


def table(records: Sequence[Record], parts: Sequence[Part]) -> tuple[list[str], str]:
    """The lines of the table in Markdown, and the last line."""
    columns: dict[str, dict[str, str]] = {"cases": {}, "changed": {}, "better": {}, "worse": {}}
    said, whole = [], Method.OURS.value
    for part in parts:
        both = [r for r in records if {whole, file_name(part)} <= r.answers.keys()]
        pairs = [(r.truth, r.answers[whole], r.answers[file_name(part)]) for r in both]
        better = sum(is_wrong(t, a) and not is_wrong(t, b) for t, a, b in pairs)
        worse = sum(is_wrong(t, b) and not is_wrong(t, a) for t, a, b in pairs)
        changed = sum(_is_other(a, b) for _, a, b in pairs)
        for head, number in zip(columns, (len(pairs), changed, better, worse), strict=True):
            columns[head][part.value] = str(number)
        said.append(f"{part.word}_better={better} {part.word}_worse={worse}")
    return markdown_table(list(columns), list(columns.values())), " ".join([f"cases={len(records)}", *said])


def _is_other(one: Answer, two: Answer) -> bool:
    """Whether two answers differ in their verdict or names."""
    return one.verdict is not two.verdict or set(one.named) != set(two.named)


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", type=Split, choices=list(Split), default=Split.VARIED,
                        metavar="varied|tuning|judging", help="which cases (default varied)")  # fmt: skip
    parser.add_argument("--families", nargs="+", choices=[f.value for f in Family], default=[], metavar="LETTER")
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=6, help="how many numbers")
    words = [part.word for part in Part]
    parser.add_argument("--parts", nargs="+", choices=words, default=words, metavar="PART",
                        help=f"of {', '.join(words)}; all by default")  # fmt: skip
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    options = parser.parse_args(arguments)
    results, parts = ResultFolder(options.out), [part for part in Part if part.word in options.parts]
    keys, names = keys_of(options.split, options.families, options.first, options.cases), list(map(file_name, parts))
    jobs = []
    for key in keys:
        if missing := results.missing(key, names):
            jobs.append(Job(key, tuple(part for part in parts if file_name(part) in missing), results))
    run_all(run_job, jobs, options.workers, options.out)
    lines, last = table(results.records(keys, [Method.OURS.value, *names]), parts)
    print("\n".join(lines))
    print(last)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
