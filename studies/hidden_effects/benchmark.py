"""Benchmark of hidden effects: how often do methods name the effects that are hidden in synthetic campaigns?

    python -m studies.hidden_effects [--split varied|tuning|judging] [--families b c …] [--first K] [--cases N]
                                     [--methods ours,previous,bic,correlation] [--workers K] [--out DIR]

Each case is a campaign made by an integrator and sensor models that no method uses. A case is determined by split,
family and number; `--cases` from `--first` on are run of each family. The family of a judging or tuning case follows
from its number: `--split judging --cases 340` are all that judge.

Each answer is stored in DIR when it is there and not computed again, so that the same command continues a study that
was stopped, and another method can be added later. An answer that ended in an error counts as wrong.

`previous` is `edhas diagnose` of an earlier version of the project, with that version's own studies:

    git archive COMMIT | tar -x -C EMPTY                  # the earlier version, into a folder that exists
    cd EMPTY; PYTHONPATH=EMPTY python -m studies.hidden_effects --methods previous --out SAME …

SAME is the result folder, as an absolute path. The cases are drawn there too; one whose hidden effects are not those
that are stored is left out. The rival methods can be run in the same way.

The last line has the main figures of each method as `key=value`: `ours_top1=… ours_in_set=… … bic_top1=… …`.
"""

import argparse
import dataclasses
from collections.abc import Iterable
from pathlib import Path

from studies.hidden_effects.answers import Answer, Truth
from studies.hidden_effects.generators.drawing import draw
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, Split, keys_of
from studies.hidden_effects.methods import Method, SharedParts, answer_with
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
    """Draw a case, ask every method, store each answer; a sentence on them, which hides those to a judging case."""
    stored = job.results.truth(job.key)
    try:
        case = draw(job.key, stored.attempt if stored else 0)
    except RuntimeError as error:
        job.results.store_failed_draw(job.key, str(error))
        return f"{job.key}: not drawn: {error}"
    if stored is None:
        job.results.store_truth(job.key, case.truth)
    elif not case.is_same(stored):
        return f"{job.key}: left out, as another case has been drawn for {job.results.folder}"
    shared, said = SharedParts(case), []
    for method in job.methods:
        answer = answer_with(method, case, shared)
        job.results.store_answer(job.key, method.value, answer)
        said.append(f"{method.value}: {_answer_text(answer)}")
    if job.key.split is Split.JUDGING:
        return f"{job.key}: answered by {', '.join(method.value for method in job.methods)}"
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
    run_all(run_job, jobs, workers, results.folder)


def main(arguments: list[str] | None = None) -> int:
    """Run the study from the command line and return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", type=Split, choices=list(Split), default=Split.VARIED,
                        metavar="varied|tuning|judging", help="which cases (default varied)")  # fmt: skip
    parser.add_argument("--families", nargs="+", choices=[f.value for f in Family], default=[], metavar="LETTER",
                        help="; ".join(f"{f.value}: {f.name.lower().replace('_', ' ')}" for f in Family))  # fmt: skip
    parser.add_argument("--first", type=int, default=0, help="number of the first case")
    parser.add_argument("--cases", type=int, default=40, help="how many numbers")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/hidden_effects"))
    parser.add_argument("--methods", type=_methods, default=(Method.OURS,), metavar="METHOD,METHOD",
                        help=f"of {', '.join(m.value for m in Method)}; ours by default")  # fmt: skip
    options = parser.parse_args(arguments)
    results, methods = ResultFolder(options.out), options.methods
    keys = keys_of(options.split, options.families, options.first, options.cases)
    if not keys:
        parser.error(f"no {options.split.value} case of {', '.join(options.families)} among these numbers")
    study(keys, methods, options.workers, results)
    records = results.records(keys, [m.value for m in methods])
    print(f"\n{options.split.value} cases {keys[0]} … {keys[-1]}")
    print(report(records, results.not_drawn(keys)))
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
