"""Answers of the benchmark that are kept in a file of the project, and the tables that follow from them.

    python -m studies.hidden_effects.published [--split judging|tuning|varied] [--families b c …] [--methods METHOD …]
                                               [--file FILE] [--add DIR --commit NAME] [--to DIR]

Prints the report of the benchmark for the kept answers, without running any case: those to judging cases, or those to
the cases of another `--split`; with `--families` only those of some families, with `--methods` only those of some
methods, which are then compared on the cases that all of them were run on. `--to` writes the same answers as a result
folder, from which the benchmark can be continued with more cases or other methods. `--add` copies the finished cases of
a result folder into the file, and notes the commit of the code that computed them; an answer that is in the file
already is not replaced.

The last line has the main figures of each method as `key=value`: `ours_top1=… ours_in_set=… … bic_top1=… …`.
"""

import argparse
import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from edhas_jax.core.atomic_file import atomic_write
from studies.hidden_effects.answers import (
    Answer,
    answer_as_json,
    answer_from_json,
    truth_as_json,
    truth_from_json,
)
from studies.hidden_effects.generators.hidden_case import CaseKey, Family, Split, key_of
from studies.hidden_effects.methods import Method
from studies.hidden_effects.report import last_line, report
from studies.hidden_effects.store import Record, ResultFolder, limit_from_json

DIGITS = 5  # significant digits of a number in the file
RANKED = 5  # names in the file of the most probable ones


@dataclasses.dataclass(frozen=True)
class KeptCase:
    """A case with the answers to it, and for each method the commit of the code that computed its answer."""

    record: Record
    commits: dict[str, str]

    @property
    def key(self) -> CaseKey:
        """What determines the case."""
        return key_of(self.record.truth)


def file_of(split: Split) -> Path:
    """The file of the project that keeps the answers to the cases of a split."""
    return Path(__file__).with_name(f"published_{split.value}.jsonl")


def read_kept(file: Path) -> dict[CaseKey, KeptCase]:
    """The cases in a file by their keys; none if the file does not exist."""
    if not file.exists():
        return {}
    cases = [_case(json.loads(line)) for line in file.read_text(encoding="utf-8").splitlines()]
    return {case.key: case for case in cases}


def write_kept(kept: Mapping[CaseKey, KeptCase], file: Path) -> None:
    """Write cases to a file, one per line, ordered by family and number."""
    rows = (json.dumps(_plain(kept[key]), separators=(",", ":")) for key in sorted(kept, key=str))
    with atomic_write(file) as temporary:
        temporary.write_text("".join(row + "\n" for row in rows), encoding="utf-8")


def added(kept: Mapping[CaseKey, KeptCase], records: Iterable[Record], commit: str) -> dict[CaseKey, KeptCase]:
    """The kept cases together with some records; an answer that is kept already is not replaced."""
    out = dict(kept)
    for record in records:
        case = KeptCase(record, dict.fromkeys(record.answers, commit))
        known = out.get(case.key)
        if known is not None:
            answers, limit = record.answers | known.record.answers, record.limit or known.record.limit
            case = KeptCase(Record(known.record.truth, answers, limit), case.commits | known.commits)
        if case.record.answers:
            out[case.key] = case
    return out


def write_folder(records: Iterable[Record], results: ResultFolder) -> None:
    """Write cases and answers as a result folder."""
    for record in records:
        key = key_of(record.truth)
        results.store_truth(key, record.truth)
        for method, answer in record.answers.items():
            results.store_answer(key, method, answer)
        if record.limit is not None:
            results.store_limit(key, record.limit)


def _plain(case: KeptCase) -> dict[str, Any]:
    record = case.record
    answers = {method: answer_as_json(_short(answer)) for method, answer in record.answers.items()}
    limit = None if record.limit is None else dataclasses.asdict(record.limit) | {"each": list(record.limit.each)}
    parts = {"truth": truth_as_json(record.truth), "answers": answers, "limit": limit}
    return {name: _rounded(part) for name, part in parts.items()} | {"commits": case.commits}


def _short(answer: Answer) -> Answer:
    """An answer without names that neither a table nor a figure needs."""
    return dataclasses.replace(answer, ranked=answer.ranked[:RANKED])


def _case(plain: dict[str, Any]) -> KeptCase:
    answers = {method: answer_from_json(answer) for method, answer in plain["answers"].items()}
    limit = None if plain["limit"] is None else limit_from_json(plain["limit"])
    return KeptCase(Record(truth_from_json(plain["truth"]), answers, limit), plain["commits"])


def _rounded(value: Any) -> Any:
    """Dictionaries and lists in which every number is rounded to `DIGITS` significant digits."""
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}")
    if isinstance(value, dict):
        return {n: _rounded(v) for n, v in value.items()}
    return list(map(_rounded, value)) if isinstance(value, list) else value


def main(arguments: list[str] | None = None) -> int:
    """Add answers to the file and print their tables, from the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--split", type=Split, choices=list(Split), default=Split.JUDGING,
                        metavar="judging|tuning|varied", help="which cases (default judging)")  # fmt: skip
    parser.add_argument("--families", nargs="+", choices=[f.value for f in Family], metavar="LETTER",
                        help="tables of these families only (default all)")  # fmt: skip
    parser.add_argument("--methods", nargs="+", choices=[m.value for m in Method], metavar="METHOD",
                        help="tables of these methods only (default all that have answers)")  # fmt: skip
    parser.add_argument("--file", type=Path, help="file of kept answers (default: that of the project)")
    parser.add_argument("--add", type=Path, metavar="DIR", help="add the cases of this result folder to the file")
    parser.add_argument("--commit", default="", help="with --add: commit of the code that computed them")
    parser.add_argument("--to", type=Path, metavar="DIR", help="write these answers as a result folder")
    options = parser.parse_args(arguments)
    file, split = options.file or file_of(options.split), options.split
    kept = read_kept(file)
    methods = options.methods or [m.value for m in Method]
    if options.add is not None:
        if not options.commit:
            parser.error("--add needs --commit: which commit computed the answers")
        if not (options.add / split.value).is_dir():
            parser.error(f"{options.add}: no folder of results with {split.value} cases")
        kept = added(kept, ResultFolder(options.add).all_records(split, methods), options.commit)
        write_kept(kept, file)
    shown = [kept[key] for key in sorted(kept, key=str) if key.family in (options.families or key.family)]
    answers = [{m: a for m, a in case.record.answers.items() if m in methods} for case in shown]
    records = [dataclasses.replace(case.record, answers=of) for case, of in zip(shown, answers, strict=True) if of]
    if not records:
        of = f"of {', '.join(options.families)}" if kept and options.families else f"to {split.value} cases"
        print(f"{file}: no kept answers {of}")
        return 1
    if options.to is not None:
        write_folder(records, ResultFolder(options.to))
    commits = sorted({commit for case in shown for m, commit in case.commits.items() if m in methods})
    print(f"answers of {', '.join(commits)}")
    print(report(records, {}))
    print(last_line(records))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
