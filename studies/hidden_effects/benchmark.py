"""Benchmark of hidden effects: how often do methods name the effects that are hidden in synthetic campaigns?

    python -m studies.hidden_effects [--families a b …] [--split judging|tuning|practice|varied|earlier]
                                     [--cases N] [--first K] [--workers K] [--out DIR]
                                     [--methods ours,bic,…] [--sensor-lags] [--baselines]

Each case is a campaign made by an integrator and sensor models that no method uses. A case is determined by family,
split and number; `--cases` from `--first` (or `--seed`) on are run of each family. Family (a), the default, has one
effect of the library in a bench that is otherwise as the model says; there the split follows from the number: cases
from 40000 on are judging ones, those from 11000 to 39999 earlier ones, those below 11000 tuning ones.

Each answer is stored in DIR when it is there and not computed again, so that the same command continues a study that
was stopped, and another method can be added later. An answer that ended in an error counts as wrong. The classifier
needs training cases in DIR, which `python -m studies.hidden_effects.training` makes.

The last line has the main figures of each method as `key=value`: `ours_top1=… ours_in_set=… … bic_top1=… …`.
"""

import argparse
import dataclasses
import sys
from collections.abc import Iterable
from pathlib import Path

from studies.hidden_effects.answers import Answer, Truth
from studies.hidden_effects.calibrated_case import CalibratedCase
from studies.hidden_effects.drawing import FAMILIES, LIBRARY_FAMILY, CaseKey, draw, first_number, split_of
from studies.hidden_effects.figures import save_figures
from studies.hidden_effects.generators.hidden_case import Split
from studies.hidden_effects.methods import Method, answer_with, what_is_missing
from studies.hidden_effects.report import last_line, report
from studies.hidden_effects.store import ResultFolder
from studies.hidden_effects.work import run_all


@dataclasses.dataclass(frozen=True)
class Job:
    """One case to be run: the methods without an answer, and where the answers go."""

    key: CaseKey
    methods: tuple[Method, ...]
    results: ResultFolder


def run_job(job: Job) -> str:
    """Draw a case, ask every method, store each answer; a sentence on them."""
    try:
        case = draw(job.key)
    except RuntimeError as error:
        job.results.store_failed_draw(job.key, str(error))
        return f"{job.key}: not drawn: {error}"
    job.results.store_truth(job.key, case.truth)
    shared, said = CalibratedCase(case, job.results.training), []
    for method in job.methods:
        answer = answer_with(method, case, shared)
        job.results.store_answer(job.key, method.value, answer)
        said.append(f"{method.value}: {_answer_text(answer)}")
    return f"{job.key}: {_truth_text(case.truth)} → {'; '.join(said)}"


def _truth_text(truth: Truth) -> str:
    return (" + ".join(h.name for h in truth.hidden) or "nothing") + (" (withheld)" if truth.withheld else "")


def _answer_text(answer: Answer) -> str:
    if answer.verdict is None:
        return answer.failed
    place = f" at {answer.place}" if answer.place and not answer.named else ""
    return f"{' + '.join(answer.named) or answer.first}{place} ({answer.seconds:.0f} s)"


def study(keys: Iterable[CaseKey], methods: tuple[Method, ...], workers: int, results: ResultFolder) -> None:
    """Run the methods on the cases that they have no answer to yet.

    Args:
        keys: the cases.
        methods: the methods.
        workers: number of processes, each with one core; with 1 the cases run in this process.
        results: where the answers are stored.
    """
    jobs = []
    for key in keys:
        if missing := results.missing(key, [m.value for m in methods]):
            jobs.append(Job(key, tuple(m for m in methods if m.value in missing), results))
    run_all(run_job, jobs, workers)


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--families", nargs="+", choices=FAMILIES, default=[LIBRARY_FAMILY], metavar="LETTER",
                        help="; ".join(f"{letter}: {family.value}" for letter, family in FAMILIES.items()))  # fmt: skip
    parser.add_argument(
        "--split", choices=[split.value for split in Split], default=Split.JUDGING.value,
        help="judging (default): to compare methods with; tuning: to choose thresholds with, and to train; practice: "
        "the same with further laws; varied: for development too, with laws drawn anew in every case; earlier: for "
        "development, what judged before",
    )  # fmt: skip
    parser.add_argument("--cases", type=int, default=40, help="number of cases of each family")
    parser.add_argument("--first", "--seed", type=int, help="number of the first case")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    parser.add_argument("--methods", type=_methods, metavar="METHOD,METHOD",
                        help=f"of {', '.join(m.value for m in Method)}; all that can run by default")  # fmt: skip
    parser.add_argument("--baselines", action="store_true", help="every method but ours")
    parser.add_argument("--sensor-lags", action="store_true",
                        help="family a: give every sensor a lag of 20 … 50 µs that is not in the library")  # fmt: skip
    options = parser.parse_args(arguments)
    results = ResultFolder(options.out)
    methods = options.methods or tuple(m for m in Method if not (options.baselines and m is Method.OURS))
    lacking = {m: sentence for m in methods if (sentence := what_is_missing(m, results.training))}
    if lacking and options.methods:
        parser.error("; ".join(lacking.values()))
    for method, sentence in lacking.items():
        print(f"without {method.value}: {sentence}")
    methods = tuple(m for m in methods if m not in lacking)
    keys = []
    for family in options.families:
        first = first_number(family, Split(options.split)) if options.first is None else options.first
        try:
            split = split_of(family, first, options.cases, Split(options.split))
        except ValueError as error:
            parser.error(str(error))
        lags = options.sensor_lags and family == LIBRARY_FAMILY
        keys += [CaseKey(family, split, number, lags) for number in range(first, first + options.cases)]
    try:
        study(keys, methods, options.workers, results)
    except KeyboardInterrupt:
        print(f"stopped; answers so far are in {options.out}, the same command continues with the rest",
              file=sys.stderr)  # fmt: skip
        return 130
    records = results.records(keys, [m.value for m in methods])
    kinds = {split: "test" if split is Split.JUDGING else "development" for split in Split}
    print(f"\n{' and '.join(dict.fromkeys(kinds[key.split] for key in keys))} cases {keys[0]} … {keys[-1]}")
    print(report(records, results.not_drawn(keys)))
    save_figures(records, options.out)
    print(last_line(records))
    return 0


def _methods(text: str) -> tuple[Method, ...]:
    """The methods of a comma-separated list, in the order of `Method`."""
    words = set(text.split(","))
    unknown = words - {m.value for m in Method}
    if unknown:
        known = ", ".join(m.value for m in Method)
        raise argparse.ArgumentTypeError(f"no method {', '.join(sorted(unknown))}; there are {known}")
    return tuple(m for m in Method if m.value in words)
